"""The README's score card from a finished run: `python -m sim.proof.readme DIR README.md`."""

from __future__ import annotations

import sys
from pathlib import Path

from bhm_service.errors import BadInputError
from sim.proof.run import Proof, scored
from sim.proof.words import ABOUT, HEADER, circumstances, line, outcome, shown

BEGIN, END = "<!-- score card: begin -->", "<!-- score card: end -->"


def main() -> int:
    """Replace the section."""
    folder, readme = map(Path, sys.argv[1:3])
    try:
        write(scored(folder), readme)
    except BadInputError as why:
        print(f"readme: {why}", file=sys.stderr)
        return 2
    return 0


def write(proof: Proof, readme: Path) -> None:
    """Put a proof's card between the marks. Raises BadInputError where the marks are missing."""
    text = readme.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise BadInputError(str(readme), f"must hold {BEGIN} and {END} once each")
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    readme.write_text(f"{head}{BEGIN}\n{section(proof)}\n{END}{tail}", encoding="utf-8")


def section(proof: Proof) -> str:
    """The card as Markdown: misses included."""
    parts = [f"**{outcome(proof.scores)}** ({circumstances(proof.about)}; SHA-256 `{proof.about['sha256'][:16]}`)"]
    for score in proof.scores:
        rows = ["| " + " | ".join(cell or "-" for cell in line(row)) + " |" for row in shown(score)]
        head = "| " + " | ".join(name or " " for name in HEADER) + " |\n|" + "---|" * len(HEADER)
        title = f"{score.suite}: {ABOUT.get(score.suite, '')}, {len(score.judgements)} cases"
        parts.append(f"{title}\n\n{head}\n" + "\n".join(rows))
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(main())
