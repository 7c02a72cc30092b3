"""Which form of a model recordings support: what the paper's models lack joins only where it predicts what no fit saw.

An addition has to lower the error on unseen pieces by a twentieth, and both halves of the recordings must agree on its
size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bhm_service.identification.experiment import Experiment
from bhm_service.identification.families import CircFamily, Extras, Family
from bhm_service.identification.premises import Premises, problem_for
from bhm_service.identification.unseen import BETTER, unseen_error

_WARM_K = 5.0  # a temperature that moves less tells nothing of resistance

Progress = Callable[[str], None]


def choose(
    family: Family, experiments: Sequence[Experiment], premises: Premises, *, any_curve: bool, progress: Progress
) -> tuple[Family, float, list[str]]:
    """The form that predicts unseen pieces best, its error there [V], and what was found on the way.

    ``any_curve``: Circ's curve may become the paper's cubic where that is as good.
    """

    def unseen(candidate: Family, what: str) -> tuple[float, bool]:
        progress(f"{candidate.name}: {what}")
        return unseen_error(problem_for(candidate, experiments, premises))

    remarks: list[str] = []
    best = family
    error, _ = unseen(family, "pieces that the fit does not see")
    if isinstance(family, CircFamily) and any_curve:
        cubic = replace(family, ocv="cubic")
        by_cubic, _ = unseen(cubic, "the paper's cubic curve")
        kind, other = "a spline", "the paper's cubic capacitance"
        if by_cubic <= error:
            best, error, by_cubic, kind, other = cubic, by_cubic, error, other, kind
        remarks.append(
            f"open-circuit curve: {kind}; unseen pieces are off by {1e3 * error:.1f} mV, with {other} by "
            f"{1e3 * by_cubic:.1f} mV"
        )
    for what, extras in _additions(best, experiments):
        candidate = best.with_extras(extras(best.extras))
        by_it, sound = unseen(candidate, what)
        joins = by_it < BETTER * error and sound
        remarks.append(
            f"{what}: {'joins' if joins else 'left out'}; unseen pieces are off by {1e3 * by_it:.1f} mV with it, "
            f"{1e3 * error:.1f} mV without{'' if sound else ', and its size is not told'}"
        )
        if joins:
            best, error = candidate, by_it
    return best, error, remarks


def _additions(family: Family, experiments: Sequence[Experiment]) -> list[tuple[str, Callable[[Extras], Extras]]]:
    found: list[tuple[str, Callable[[Extras], Extras]]] = []
    if not family.extras.slow:
        found.append(("slow diffusion", lambda e: replace(e, slow=True)))
    kelvin = [e.temperature_k for e in experiments if e.temperature_k is not None]
    if len(kelvin) == len(experiments) and not family.extras.temperature:
        everything = np.concatenate(kelvin)
        if float(np.quantile(everything, 0.98) - np.quantile(everything, 0.02)) > _WARM_K:
            found.append(("resistance that follows temperature", lambda e: replace(e, temperature=True)))
    return found
