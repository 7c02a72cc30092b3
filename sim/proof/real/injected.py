"""Faults added to real drive cycles by a coin that nobody sees; a third of the cases gets nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim.proof.cases import write_pack
from sim.proof.real.recordings import Array, Recording, read_bench, write_bench, write_log
from sim.proof.scoring.answers import Answer, Criterion, Names, Quantity

_NOISE_V = 0.004  # [V] what two runs of this cell differ by when nothing was changed, for the SNR
_RIGHT = (Criterion("accepted", at_least=1.0),)
_CLEAR_SNR = 15.0  # from here on it must be named
_TAU_S = 30.0  # errors of a model are alike for so long: samples within it count once


@dataclass(frozen=True, slots=True)
class Fault:
    """What may be added: its effect's name, those nobody can tell from it, sizes, and how a recording changes."""

    effect: str
    twins: tuple[str, ...]
    parameter: str
    unit: str
    sizes: tuple[float, float]
    add: Callable[[Recording, float], Recording]

    @property
    def accept(self) -> tuple[Names, ...]:
        """Right answers."""
        return tuple(frozenset({name}) for name in (self.effect, *self.twins))


def _past_the_sensor(r: Recording, ampere: float) -> Recording:
    return replace(r, current_a=r.current_a - ampere)


def _gain(r: Recording, gain: float) -> Recording:
    return replace(r, current_a=r.current_a / (1.0 + gain))


def _offset(r: Recording, volt: float) -> Recording:
    return replace(r, voltage_v=r.voltage_v + volt)


def _contact(r: Recording, milliohm: float) -> Recording:
    return replace(r, voltage_v=r.voltage_v - 1e-3 * milliohm * r.current_a)


def _ahead(r: Recording, seconds: float) -> Recording:
    """The voltage is told ``seconds`` before the current that caused it; a negative number: after."""
    return replace(r, voltage_v=np.interp(r.time_s + seconds, r.time_s, r.voltage_v))


FAULTS = (
    Fault("unseen-load", ("current-offset",), "current", "A", (0.10, 0.30), _past_the_sensor),
    Fault("current-gain", (), "gain", "1", (0.04, 0.10), _gain),
    Fault("voltage-offset", ("voltage-gain",), "offset", "V", (0.025, 0.060), _offset),
    Fault("contact-resistance", ("resistance-growth",), "resistance", "mohm", (5.0, 15.0), _contact),
    Fault("time-skew", (), "skew", "s", (-2.0, -0.5), _ahead),
)


@dataclass(frozen=True, slots=True)
class InjectedCase:
    """Panasonic 18650PF at 25 degC: its own C/20, 1C and pulse runs, then two drive cycles with a fault or without."""

    name: str
    data: Path
    fault: Fault | None
    size: float

    def __call__(self, folder: Path, held: Path) -> list[Answer]:
        """Write what may be seen."""
        source = self.data / "lab" / "panasonic_18650pf"
        case = folder / self.name
        write_pack(case, series=1)
        (case / "lab").mkdir()
        (case / "flights").mkdir()
        for kind, file in (("slow", "c20_ocv_25C"), ("one_c", "dis1C_start_1_25C")):
            write_bench(case / "lab" / f"{kind}.csv.gz", read_bench(source / f"{file}.csv.gz"))
        # Without steps of the load no lab knows a cell's resistance. As it is: it counts the charge of its gaps.
        shutil.copyfile(source / "hppc_lite_25C.csv.gz", case / "lab" / "pulses.csv.gz")
        snr = []
        for k, file in enumerate(("drive_Cycle_1_25C", "drive_US06_25C")):
            plain = read_bench(source / f"{file}.csv.gz")
            shown = plain if self.fault is None else self.fault.add(plain, self.size)
            snr.append(_snr(plain, shown))
            write_log(case / "flights" / f"{k:02d}.tlog", shown, k, with_temperature=True)
        group = "Panasonic 18650PF at 25 degC, injection"
        if self.fault is None:
            return [
                Answer(case=self.name, kind="injected", group=group, accept=(frozenset({"none"}),), criteria=_RIGHT)
            ]
        truth = Quantity(self.size, self.fault.unit)
        whole = float(np.linalg.norm(snr))
        return [
            Answer(
                case=self.name,
                kind="injected",
                group=group,
                accept=self.fault.accept,
                truth=frozenset({self.fault.effect}),
                snr=whole,
                criteria=_RIGHT if whole >= _CLEAR_SNR else (),
                parameters={self.fault.effect: {self.fault.parameter: truth}},
            )
        ]


def injected(data: Path, seed: int, names: list[str]) -> list[InjectedCase]:
    """A third gets nothing; the others a fault each, in an order that only the seed knows."""
    dice = np.random.default_rng(seed)
    chosen: list[Fault | None] = [None] * (len(names) // 3)
    chosen += [FAULTS[int(k)] for k in dice.integers(len(FAULTS), size=len(names) - len(chosen))]
    order = dice.permutation(len(chosen))
    return [
        InjectedCase(name, data, chosen[k], 0.0 if fault is None else float(dice.uniform(*fault.sizes)))
        for name, k in zip(names, order, strict=True)
        for fault in (chosen[k],)
    ]


def _snr(plain: Recording, shown: Recording) -> float:
    """Root of the summed squares of the voltage that a fault makes over the noise, in independent samples.

    A fault of the current counts by its drop across the cell's own resistance and by the charge that it hides.
    """
    step = float(np.median(np.diff(plain.time_s)))
    missed = plain.current_a - shown.current_a
    made = shown.voltage_v - plain.voltage_v + _RESISTANCE * missed + _SLOPE * np.cumsum(missed) * step
    return float(np.sqrt(np.sum(_averaged(made, max(1, round(_TAU_S / step))) ** 2)) / _NOISE_V)


_RESISTANCE, _SLOPE = 0.035, 0.9 / (2.9 * 3600.0)  # [ohm], [V/C] of this cell at 25 degC


def _averaged(values: Array, count: int) -> Array:
    whole = values[: values.size // count * count].reshape(-1, count)
    return np.asarray(whole.mean(axis=1))
