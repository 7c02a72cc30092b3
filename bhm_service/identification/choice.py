"""Which form of a model recordings support: what the paper's models lack joins only where it predicts what no fit saw.

An addition has to lower the error on unseen pieces by a twentieth, and both halves of the recordings must agree on its
size. Where they do not, it has to lower that error by a quarter if it is over with a piece, and to foretell every
recording under load better by the others if it may last for longer: what is known only loosely of its size stands in
its standard deviations. Graphite's lag bends with the load and the charge, and is carried on far: it has to foretell a
varying load (where none was recorded, every load) by the other recordings better by a quarter as well. What is over
within seconds is judged by the error from one sample to the next alone. What makes a model follow steps of the curve
(charge that lags at the surface; what Chem's series leaves of the curve) is held against its absence with all that
joins beside either. That resistance follows temperature, and by how much, is known of lithium-ion cells before: it
joins unless it does harm, or is of another size: then something else goes with the temperature here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.extras import Extras
from bhm_service.identification.families import CircFamily, Family
from bhm_service.identification.premises import Premises, problem_for
from bhm_service.identification.unseen import BETTER, Unseen, foretold, unseen_error

_MUCH_BETTER = 0.75  # of the error without it: no chance, whatever two halves have of its size
_MISSED = 2.0  # standard deviations of the recorded curve: a form that is further off is not its
_WARM_K = 5.0  # a temperature that moves less tells nothing of resistance

_FAST, _FULL, _SLOW = "charge transfer within seconds", "resistance near full charge", "slow diffusion"
_FINER = {"circ": "charge that lags at the particles' surface", "chem": "what the series leaves of the curve"}
_STAGES = "lithium that lags at the surface of graphite"
_WARM, _HOUR, _CURVE = "resistance that follows temperature", "diffusion over an hour", "open-circuit curve"
_CURVES = ("a spline", "the paper's cubic capacitance")

Progress = Callable[[str], None]


def choose(
    family: Family, experiments: Sequence[Experiment], premises: Premises, *, any_curve: bool, progress: Progress
) -> tuple[Family, float, list[str]]:
    """The form that predicts unseen pieces best, its error there [V], and what was found on the way.

    ``any_curve``: Circ's curve may become the paper's cubic where that is as good and follows the recorded one.
    """

    def unseen(candidate: Family, what: str) -> Unseen:
        progress(f"{candidate.name}: {what}")
        return unseen_error(problem_for(candidate, experiments, premises))

    def with_additions(bare: Family, curve: str, alone: Unseen | None = None) -> tuple[Family, Unseen, dict[str, str]]:
        error = alone or unseen(bare, f"pieces that the fit does not see{curve}")
        best, said = bare, dict[str, str]()
        additions = _additions(bare, experiments)
        judged: dict[str, Extras] = {}  # beside what each was left out: a fault that is mended since may have hidden it
        while open_ := [what for what in additions if judged.get(what) != best.extras]:
            what = open_[0]
            candidate = best.with_extras(additions[what](best.extras))
            by_it = unseen(candidate, what + curve)
            better = by_it.possible and _of_cells(what, by_it) and _better(what, by_it, error)
            joins = better and what != _STAGES and (by_it.agreed or _whatever_its_size(what, by_it, error))
            loosely = "" if by_it.agreed and by_it.possible else ", and its size is not told"
            if joins and not by_it.agreed:
                loosely = ", its size loosely told"
            elif better and not joins:
                joins, foreseen = foretells(best, candidate, flying=what == _STAGES)
                size = "" if by_it.agreed else ", its size loosely told"
                loosely = f"{size}; {foreseen}" if foreseen else loosely
            said[what] = _judged(what, by_it, error, joins=joins) + loosely
            judged[what] = best.extras
            if joins:
                best, error = candidate, by_it
                del additions[what]
        return best, error, said

    def with_finer(bare: Family, curve: str) -> tuple[Family, Unseen, dict[str, str]]:
        finer, what = bare.finer(recorded=any(e.kind is Kind.SLOW for e in experiments)), _FINER[bare.name]
        if finer is None:
            return with_additions(bare, curve)
        alone = unseen(bare, f"pieces that the fit does not see{curve}")
        by_it = unseen(finer, what + curve)
        best, error, said = with_additions(bare, curve, alone)
        if by_it.typical >= alone.typical:
            return best, error, {what: _judged(what, by_it, alone, joins=False)} | said
        # What joins where it is missing makes up for it, and what joins beside it is another thing: by itself it may
        # stand at its bounds for that.
        other, by_it, beside = with_additions(finer, f"{curve}, {what}", by_it)
        joins = by_it.possible and by_it.typical < BETTER * error.typical
        told = {what: _judged(what, by_it, error, joins=joins)}
        return (other, by_it, told | beside) if joins else (best, error, told | said)

    def foretells(bare: Family, candidate: Family, *, flying: bool = False) -> tuple[bool, str]:
        by_one, by_two = (foretold(problem_for(f, experiments, premises)) for f in (bare, candidate))
        # A full discharge is foretold by nothing that was never under load at its charges; a flight is by one.
        varying = [k for k in by_one if flying and experiments[k].kind is Kind.VARIABLE]
        told, least = varying or list(by_one), _MUCH_BETTER if flying else BETTER
        if not told:
            return False, ""
        joins = all(by_two[k] < least * by_one[k] for k in told)
        one, two = (_listed([by[k] for k in told]) for by in (by_one, by_two))
        return joins, f"recordings foretold by the others are off by {two} mV with it, {one} mV without"

    def with_an_hour(best: Family, error: Unseen, said: dict[str, str]) -> tuple[Family, Unseen, dict[str, str]]:
        if not best.extras.slow:
            return best, error, said
        slower = best.with_extras(replace(best.extras, slower=True))
        progress(f"{best.name}: {_HOUR}")
        joins, foreseen = foretells(best, slower)
        if not foreseen:
            return best, error, said
        if joins:
            best, error = slower, unseen(slower, "pieces that the fit does not see")
        return best, error, said | {_HOUR: f"{_HOUR} beside it: {'joins' if joins else 'left out'}; {foreseen}"}

    def with_warmth(best: Family, error: Unseen, said: dict[str, str]) -> tuple[Family, float, list[str]]:
        # Last: warmth grows with the charge drawn, so it would stand in for what is slow and has not joined yet.
        if _WARM in _additions(best, experiments):
            warm = best.with_extras(replace(best.extras, temperature=True))
            by_it = unseen(warm, _WARM)
            joins = by_it.typical < error.typical and _of_cells(_WARM, by_it)
            size = "" if _of_cells(_WARM, by_it) else ", and its size is no cell's"
            said = said | {_WARM: _judged(_WARM, by_it, error, joins=joins) + size}
            if joins:
                best, error = warm, by_it
        return best, error.rms, list(said.values())

    if not (isinstance(family, CircFamily) and any_curve):
        return with_warmth(*with_an_hour(*with_finer(family, "")))
    best, error, told = with_finer(family, ", spline")
    off_v = family.cubic_off_v()
    if off_v > _MISSED * premises.curve_sd:
        # What bends the curve away from where it was measured, and does better for it, makes up for a slow drop.
        said = f"{_CURVES[0]}; {_CURVES[1]} misses the recorded one by {1e3 * off_v:.1f} mV at best"
    else:
        # Slow diffusion that is missing passes for a fault of the curve: the cubic begins with what the spline needs.
        cubic, by_it, beside = with_additions(replace(family, ocv="cubic", extras=best.extras), ", the paper's cubic")
        joins = by_it.typical <= error.typical
        said = (
            f"{_CURVES[joins]}; unseen pieces are off by {1e3 * error.typical:.1f} mV with a spline, "
            f"{1e3 * by_it.typical:.1f} mV with the cubic"
        )
        if joins:
            best, error, told = cubic, by_it, told | beside
    return with_warmth(*with_an_hour(best, error, {_CURVE: f"{_CURVE}: {said}"} | told))


def _judged(what: str, by_it: Unseen, error: Unseen, *, joins: bool) -> str:
    """What came of an addition, in words."""
    return (
        f"{what}: {'joins' if joins else 'left out'}; unseen pieces are off by {1e3 * by_it.typical:.1f} mV with it, "
        f"{1e3 * error.typical:.1f} mV without"
    )


def _better(what: str, by_it: Unseen, error: Unseen) -> bool:
    """Whether pieces are foretold better; what is over within seconds is judged from one sample to the next.

    Everything that lasts hides that, or is made up for by it.
    """
    if what == _FAST:
        return by_it.quick < BETTER * error.quick and by_it.typical < error.typical
    return by_it.typical < BETTER * error.typical


def _of_cells(what: str, by_it: Unseen) -> bool:
    """Whether an addition is of the size that it has in cells, where that is known."""
    return what != _WARM or by_it.known


def _whatever_its_size(what: str, by_it: Unseen, error: Unseen) -> bool:
    """Whether what is over with a piece foretells pieces so well that its size need not be told closely."""
    return what == _FAST or (what == _FULL and by_it.typical < _MUCH_BETTER * error.typical)


def _listed(volts: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * v:.1f}" for v in volts)


def _additions(family: Family, experiments: Sequence[Experiment]) -> dict[str, Callable[[Extras], Extras]]:
    found: dict[str, Callable[[Extras], Extras]] = {}
    if isinstance(family, CircFamily) and not family.extras.graphite:
        # First: it is in nearly every cell, and the others stand in for it. Chem has a surface of its own.
        found[_STAGES] = lambda e: replace(e, graphite=True)
    if isinstance(family, CircFamily) and not family.extras.fast:
        found[_FAST] = lambda e: replace(e, fast=True)
    if not family.extras.full:
        found[_FULL] = lambda e: replace(e, full=True)
    if not family.extras.slow:
        found[_SLOW] = lambda e: replace(e, slow=True)
    kelvin = [e.temperature_k for e in experiments if e.temperature_k is not None]
    if len(kelvin) == len(experiments) and not family.extras.temperature:
        # Each recording by itself, as a fit counts them: next to a slow discharge all others are a few samples.
        spans = np.array([np.quantile(k, (0.02, 0.98)) for k in kelvin])
        if float(spans.max() - spans.min()) > _WARM_K:
            found[_WARM] = lambda e: replace(e, temperature=True)
    return found
