"""What is said when the input is at fault: one sentence that names the place, the value and what is allowed."""

from __future__ import annotations


class BadInputError(Exception):
    """Input that cannot be used; the message is meant for the person who gave it (exit status 2)."""

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        self.where = where
        self.problem = problem
        self.hint = hint
        super().__init__(f"{where}: {problem}" + (f"\n  {hint}" if hint else ""))

    def __reduce__(self) -> tuple[type[BadInputError], tuple[str, str, str | None]]:
        """What it is made from again: an exception is pickled with its message alone, and workers' errors are."""
        return type(self), (self.where, self.problem, self.hint)
