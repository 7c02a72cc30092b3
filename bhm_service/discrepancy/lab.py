"""What the lab leaves open: the errors that a well identified model may have without any physics missing.

Scales of resistance, polarisation and capacity, the bend of the open-circuit curve, the course of resistance over SoC,
the speed of relaxation and what two meters differ by each get a small prior. An effect is only claimed beyond what
these can explain: with no such terms an effect absorbs every error of the model, with wide ones nothing could ever be
found (Brynjarsdottir & O'Hagan 2014).

What a model's form is off by (bends, drops and how they bend with the current) the lab's own recordings show. Where the
battery file says what these leave open (`lab_errors`), that is where such numbers are looked for, and only what differs
between lab and flight is added to it; else they are taken to be anywhere within what labs usually leave open.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from typing import Final

import numpy as np

from bhm_service.battery.battery_file import ModelName
from bhm_service.battery.cell import CellModel, Modifiers
from bhm_service.battery.dynamics import Follower
from bhm_service.battery.effects.base import Conditions, Effect
from bhm_service.battery.left_open import LeftOpen
from bhm_service.identification.unknowns import Block, Unknowns, numbers
from bhm_service.units import SECONDS_PER_HOUR, Array, Value

BEND_SOC = np.linspace(0.0, 1.0, 26)
DROP_SOC = np.array([0.1, 0.3, 0.55, 0.8, 1.0])
DROP_S = (0.0, 2.0, 8.0, 30.0, 120.0, 480.0)  # at once, then each relaxation a factor of four apart
_DROP_TIMES = 4.0  # about: that factor
HOVER_C = 2.0  # [1/h] load at which what a model is off by is weighed against its voltage error

# Charges at which a pack may lag by its own share: diffusion in a particle goes by how full it is, tenfold in graphite,
# and steps of a curve are a twentieth of the charge wide.
LAG_SOC = np.linspace(0.05, 1.0, 20)
_LAG_AT = DROP_S.index(30.0)  # after so many seconds: in a minute or two of hover no other time looks different

# What a model's form is off by, number by number, in the order in which `Lab.added` has them.
FORM: Final = {
    "bends": BEND_SOC.size, **{f"drop_{tau:.0f}": DROP_SOC.size for tau in DROP_S}, "lag": len(DROP_S),
    "lag_at": LAG_SOC.size, "curve": 2,
}  # fmt: skip

BEND_SD = (0.003, 0.010)  # [V] a cell's open-circuit curve is known to, at best and at worst
_BEND_SOC = 0.15  # of charge, over which a curve is off by about the same
_ROUGH = 0.1  # of what it is off by, at each charge by itself
DROP_SD = (0.03, 0.12)  # of the resistance, at each charge and relaxation, likewise
# Of charge at the hover, for each relaxation: electrodes give charge from their particles' surface first, so a cell
# under load is at its curve's voltage for less charge than it holds. Steps of a curve come earlier by as much, which no
# resistance does. From particles of 1 um (nothing) to 5 um of slow diffusion (a tenth of the charge, after minutes).
_LAG_SD = 0.02
_SECANT = 0.02  # of charge, over which the fall of a curve is taken: a lag is no derivative
_FAST = {0.0: 3.0, 2.0: 3.0, 8.0: 2.0}  # times that: once a second hardly tells one fast relaxation from another
AT_ONCE_S = 2.0  # what is slower than this the lab tells from what comes at once
_LEVEL_SD = 0.05  # of the resistance at each charge, within two seconds and a minute: the lab's own load pins it down
_LEVEL_ENDS = 3.0  # times that near full and near empty, where the lab's load is short
_LEVEL_S = 60.0  # what comes later the lab cannot tell from the open-circuit curve
_MOST_WIDER = 3.0  # times that, where the flights show that a model follows its own pack less well
# [V] of a cell: half a thousandth of it, the class of a good meter. That of the lab and that of the vehicle agree no
# closer.
_METER_SD_V = 0.0019
_SKEW_SD_S = 0.4  # two filtered channels; and what relaxes within a second no lab at one hertz sees
# Half a sample: what is later is no matter of filters, and no cell's whole ohmic drop relaxes in half a second.
_SKEW_MOST_S = 0.5
_SKEW_S = 1.0  # the lag that a skew is made of, as in the effect of that name
_REACH = 8.0  # standard deviations within which a nuisance may be fitted


@dataclass(frozen=True, kw_only=True)
class Lab:
    """A pack as the lab identified it, and how well."""

    model: ModelName
    cell: CellModel
    effects: tuple[Effect, ...]
    series: int
    parallel: float
    ohm: float  # ohmic and polarisation resistance of a cell, about
    resistance_sd: float
    polarisation_sd: float
    capacity_sd: float
    bend_sd_v: float
    ohmic_share: float  # of ``ohm``: what follows the current within two seconds
    voltage_error_v: float  # lasting error of the cell's voltage in flight, as far as the lab told (`lab_file`)
    own_error_v: float  # that of this model on pieces of the lab's recordings that no fit saw
    identified: bool  # this very pack, on a bench; not a cell like its own, nor from flights that left its scales open
    drop_sd: float  # of ``ohm``: how far the drop may be off at any charge and any time after a step
    lag_sd: float  # of charge at the hover: how far it may lag at any time after a step; zero: a part of the drop
    lag_at_sd: float  # likewise at any charge; zero: at all of them alike
    widening: Mapping[float, float] = field(default_factory=dict)  # times that, by relaxation
    left_open: LeftOpen | None = None  # the errors of form that the lab's own recordings show

    @property
    def form_told(self) -> bool:
        """Whether the lab's own recordings showed what the model's form is off by, not only its kind's usual errors."""
        return self.left_open is not None

    @cached_property
    def form_sizes(self) -> dict[str, int]:
        """Those of `FORM` that it has; of a lab that told nothing of its form a lag is a part of its drops."""
        if self.left_open is not None:
            return self.left_open.sizes
        sds = {"lag": self.lag_sd, "lag_at": self.lag_at_sd}
        return {name: size for name, size in FORM.items() if sds.get(name, 1.0) > 0.0}

    @cached_property
    def _form_places(self) -> dict[str, slice]:
        ends = accumulate(self.form_sizes.values())
        return {name: slice(end - size, end) for (name, size), end in zip(self.form_sizes.items(), ends, strict=True)}

    @property
    def capacity_c(self) -> float:
        """Of the pack. [C]"""
        return float(np.asarray(self.cell.capacity_c)) * self.parallel

    @property
    def pack_ohm(self) -> float:
        """Ohmic and polarisation resistance of the pack, about. [Ohm]"""
        return self.ohm * self.series / self.parallel

    @property
    def ohmic(self) -> float:
        """Resistance of the pack to what changes within two seconds. [Ohm]"""
        return self.ohm * self.ohmic_share * self.series / self.parallel

    def driven(self, drivers: Collection[str]) -> Lab:
        """The same with those of its effects that are driven by these, or by another one; nothing else moves them."""
        there = {*drivers, *(driver for effect in self.effects for driver in effect.supplies)}
        return replace(self, effects=tuple(effect for effect in self.effects if there.issuperset(effect.drivers)))

    def widened(self, pulls: Callable[[str], Array]) -> Lab:
        """The same with its shapes as uncertain as a fit found them to be, never less.

        ``pulls`` of a block are standard normals, independent of each other, where it is off as was expected.
        """

        def wider(name: str) -> float:
            return float(np.clip(np.sqrt(np.mean(pulls(name) ** 2)), 1.0, _MOST_WIDER))

        found = {tau: wider(f"lab_drop_{tau:.0f}") * self.widening.get(tau, 1.0) for tau in DROP_S}
        lag, lag_at = (wider(f"lab_{name}") if name in self.form_sizes else 1.0 for name in ("lag", "lag_at"))
        return replace(
            self,
            bend_sd_v=wider("lab_bends") * self.bend_sd_v,
            lag_sd=lag * self.lag_sd,
            lag_at_sd=lag_at * self.lag_at_sd,
            widening=found,
        )

    @property
    def drop_sds(self) -> dict[float, float]:
        """Standard deviation of the drop at each relaxation, of ``ohm``; from lab to flight where the lab told it."""
        fast = {} if self.form_told else _FAST
        return {tau: self.drop_sd * fast.get(tau, 1.0) * self.widening.get(tau, 1.0) for tau in DROP_S}

    @cached_property
    def form(self) -> tuple[Array, Array]:
        """Mean and covariance of the errors of form, in the order of `FORM`."""
        drops = np.repeat(list(self.drop_sds.values()), DROP_SOC.size)
        lags = np.repeat([self.lag_sd, self.lag_at_sd], [self.form_sizes.get(name, 0) for name in ("lag", "lag_at")])
        curve = np.full(FORM["curve"], 2.0 * self.drop_sd)
        sds = np.concatenate([np.full(BEND_SOC.size, self.bend_sd_v), drops, lags, curve])
        if self.left_open is None:
            return np.zeros(sds.size), np.diag(sds**2)
        alike = np.eye(sds.size)
        bends = slice(0, BEND_SOC.size)
        apart = np.subtract.outer(BEND_SOC, BEND_SOC) / _BEND_SOC
        alike[bends, bends] = np.exp(-0.5 * apart**2) + _ROUGH**2 * np.eye(BEND_SOC.size)
        mean = np.concatenate([np.asarray(values) for values in self.left_open.mean.values()])
        return mean, np.asarray(self.left_open.covariance + alike * np.outer(sds, sds))

    def at_worst(self, by_charge: bool) -> Lab:
        """The same with as little known of its form as labs leave open at worst, ``by_charge`` of a lag at each too."""
        lag_at_sd = _LAG_SD if by_charge else 0.0
        return replace(
            self, bend_sd_v=BEND_SD[1], drop_sd=DROP_SD[1], lag_sd=_LAG_SD, lag_at_sd=lag_at_sd, left_open=None
        )

    @property
    def bend_sds_v(self) -> Array:
        """Standard deviation of each bend. [V]"""
        return np.asarray(np.sqrt(np.diag(self.form[1])[: BEND_SOC.size]))

    def blocks(self) -> list[Block]:
        """The unknowns that every hypothesis has and that move the cell itself."""
        return [
            _near("lab_resistance", 1, self.resistance_sd),
            _near("lab_polarisation", 1, self.polarisation_sd),
            _near("lab_capacity", 1, self.capacity_sd),
        ]

    def additions(self) -> list[Block]:
        """The unknowns that every hypothesis has and that only add to the voltage."""
        mean, covariance = self.form
        sds, form = np.sqrt(np.diag(covariance)), self._form_places.items()
        return [
            *(numbers(f"lab_{name}", mean[own], sds[own], _REACH * sds[own]) for name, own in form),
            numbers("lab_skew", np.zeros(1), _SKEW_SD_S, _SKEW_MOST_S),
            # Of a lab that told nothing of its form it is a part of what its curve may be off by.
            *([_near("lab_meter", 1, _METER_SD_V)] if self.form_told else []),
        ]

    def known(self, unknowns: Unknowns) -> Array:
        """What the lab knows of the unknowns, or of sums of them; (rows, n).

        Each row, times the vector in standard deviations of what was known before, is a standard normal, independent of
        the others.
        """
        single = np.eye(unknowns.start.size)
        if self.left_open is None:
            return np.concatenate([single, self._ties(unknowns)])
        form = slice(unknowns.slice_of("lab_bends").start, unknowns.slice_of("lab_curve").stop)
        single[form, form] = _independent(self.form[1])
        return single

    def pulls(self, name: str, numbers: Array) -> Array:
        """Numbers of a block of `additions`, in standard deviations, as what is independent of each other in them."""
        own = self._form_places.get(name.removeprefix("lab_"))
        if own is None:
            return numbers
        return np.asarray(_independent(self.form[1][own, own]) @ numbers)

    def _ties(self, unknowns: Unknowns) -> Array:
        """What any lab knows of sums of the unknowns: resistance within two seconds and a minute, at each charge."""
        rows = np.zeros((2, DROP_SOC.size, unknowns.start.size))
        rows[:, :, unknowns.slice_of("lab_resistance")] = self.ohmic_share * self.resistance_sd
        rows[1, :, unknowns.slice_of("lab_polarisation")] = (1.0 - self.ohmic_share) * self.polarisation_sd
        for tau in (t for t in DROP_S if t < _LEVEL_S):
            first = unknowns.slice_of(f"lab_drop_{tau:.0f}").start
            for knot in range(DROP_SOC.size):
                rows[0 if tau <= AT_ONCE_S else 1 :, knot, first + knot] = self.drop_sds[tau]
        known = _LEVEL_SD if self.identified else self.resistance_sd
        sds = np.where((DROP_SOC > 0.2) & (DROP_SOC < 0.9), known, _LEVEL_ENDS * known)
        return np.asarray((rows / sds[:, None]).reshape(-1, unknowns.start.size))

    def added(self, followed: Array, current: Array, soc: Array, grown: Array | None = None) -> Array:
        """What one of each of `additions` adds to the pack's voltage [V] along flights (.., T); (numbers, .., T).

        ``followed`` is what `followed` makes of the current; ``grown`` are times what the drop is in the lab: of what
        follows within two seconds, and of what comes later (2, .., T).
        """
        cell, late, once = self._loads(followed, current, grown)
        drops = (-self.ohm * late[:-1, None] * hats(DROP_SOC, soc)).reshape(-1, *soc.shape)
        lags = [-self._fall_v(soc) * late[:-1] / self._hover_a] if "lag" in self._form_places else []
        if "lag_at" in self._form_places:
            lags.append(lags[0][_LAG_AT] * hats(LAG_SOC, soc))
        bent = -self.ohm * once * self._bending(cell)
        charge = np.clip(soc, 0.0, 1.0)
        skewed = -self.ohm * self.ohmic_share * (once * cell - late[-1]) / _SKEW_S
        bends = hats(BEND_SOC, soc)
        ways = [bent * (1.0 - charge), bent * charge, skewed, *([np.ones_like(charge)] if self.form_told else [])]
        return np.asarray(self.series * np.concatenate([bends, drops, *lags, np.stack(ways)]))

    def beside(self, sizes: Array, followed: Array, current: Array, soc: Array, grown: Array | None = None) -> Array:
        """What numbers of `additions` add together (.., T), as `added` has it for one of each. [V]"""
        cell, late, once = self._loads(followed, current, grown)
        places = self._form_places
        drops = sizes[BEND_SOC.size : places[f"drop_{DROP_S[-1]:.0f}"].stop].reshape(-1, DROP_SOC.size)
        low, high, skew, *meter = sizes[places["curve"].start :]
        charge = np.clip(soc, 0.0, 1.0)
        amps = once * self._bending(cell) * (low + (high - low) * charge)
        amps += (skew * self.ohmic_share / _SKEW_S) * (once * cell - late[-1])
        for hat, shares in zip(hats(DROP_SOC, soc), drops.T, strict=True):
            amps += hat * np.tensordot(shares, late[:-1], axes=1)
        bend = np.interp(soc, BEND_SOC, sizes[: BEND_SOC.size])
        volts = bend + sum(meter) - self.ohm * amps
        if "lag" in places:
            lags = np.tensordot(sizes[places["lag"]], late[:-1], axes=1)
            if "lag_at" in places:
                lags = lags + np.interp(soc, LAG_SOC, sizes[places["lag_at"]]) * late[_LAG_AT]
            volts = volts - self._fall_v(soc) * lags / self._hover_a
        return np.asarray(self.series * volts)

    def _loads(self, followed: Array, current: Array, grown: Array | None) -> tuple[Array, Array, Array]:
        """Of a cell its current, what follows it [A], as much more as the drop has grown, and by what is at once.

        What comes later relaxes against the same capacitance, so by as much later.
        """
        cell, late = current / self.parallel, followed / self.parallel
        if grown is None:
            return cell, late, np.ones(1)
        once, later = grown
        # What has hardly begun by the landing is, by as much later, begun by as much less.
        fast, latest = sum(tau <= AT_ONCE_S for tau in DROP_S), late[-2:-1] / _DROP_TIMES
        sooner, own, after = late[fast - 1 : -2], late[fast:-1], np.concatenate([late[fast + 1 : -1], latest])
        places = np.clip(np.log(later) / np.log(_DROP_TIMES), -1.0, 1.0)
        slow = later * (own + 0.5 * places * (after - sooner + places * (after - 2.0 * own + sooner)))
        return cell, np.concatenate([once * late[:fast], slow, once * late[-1:]]), once

    def _bending(self, cell: Array) -> Array:
        """How a drop bends with the current of a cell, without changing it at the hover. [A]"""
        return np.asarray(cell * (np.abs(cell) / self._hover_a - 1.0))

    @property
    def _hover_a(self) -> float:
        """Of a cell. [A]"""
        return HOVER_C * self.capacity_c / self.parallel / SECONDS_PER_HOUR

    def _fall_v(self, soc: Array) -> Array:
        """By how much the open-circuit curve falls with the charge that goes out next. [V]"""
        held = np.clip(soc, _SECANT, 1.0)
        fall = np.asarray(self.cell.open_circuit(held)) - np.asarray(self.cell.open_circuit(held - _SECANT))
        return np.asarray(fall / _SECANT)

    def slope_v(self, soc: Array, step: float) -> Array:
        """Slope of the open-circuit curve by the charge, from a ``step`` of it below to one above. [V]"""
        below, above = (np.asarray(self.cell.open_circuit(np.clip(soc + s, 0.0, 1.0))) for s in (-step, step))
        return np.asarray((above - below) / (2.0 * step))

    def bent_v(self, sizes: Array, soc: Array) -> Array:
        """What the bends among numbers of `additions` (M, numbers) add to rested packs (M, F); (M, F). [V]"""
        return np.asarray(self.series * np.einsum("mk,kmf->mf", sizes[:, : BEND_SOC.size], hats(BEND_SOC, soc)))


def _near(name: str, size: int, sd: float) -> Block:
    return numbers(name, np.zeros(size), sd, _REACH * sd)


def _independent(covariance: Array) -> Array:
    """What makes of numbers in their standard deviations as many that are independent of each other; (n, n)."""
    sds = np.sqrt(np.diag(covariance))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance / np.outer(sds, sds))))


def followed(time_s: Array, current: Array) -> Array:
    """A current (.., T) as each relaxation of the drop follows it, then a skew; (relaxations + 1, .., T)."""
    return np.stack([current if tau == 0.0 else Follower(np.diff(time_s), tau)(current) for tau in (*DROP_S, _SKEW_S)])


def hats(knots: Array, soc: Array) -> Array:
    """Triangles over ``knots`` (K,), level beyond them: (K, .., T)."""
    place = np.interp(soc, knots, np.arange(knots.size, dtype=float))
    found = place - np.arange(knots.size, dtype=float).reshape(-1, *[1] * place.ndim)
    np.abs(found, out=found)
    np.subtract(1.0, found, out=found)
    return np.asarray(np.maximum(found, 0.0, out=found))


class LabError(Effect):
    """The scales of a well identified model, as an effect; many candidates (M, 1) in one call."""

    def __init__(self, values: dict[str, Array], pack: Value = 0.0) -> None:
        polarisation = np.exp(-values["lab_polarisation"])
        self._by = Modifiers(
            resistance=np.exp(values["lab_resistance"] + pack),
            kinetics=polarisation,
            diffusion=polarisation,
            capacity=np.exp(values["lab_capacity"]),
        )

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        return self._by
