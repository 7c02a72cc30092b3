"""Charge transfer: the overpotential bends with the current (Butler-Volmer)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bhm_service.battery.cell import CellModel, Modifiers
from bhm_service.battery.effects.base import Conditions, Effect, Instant
from bhm_service.battery.parameters import parameter
from bhm_service.units import FARADAY, GAS_CONSTANT, SECONDS_PER_HOUR, Value

_CHORD_C = 2.0  # [1/h] load at which the lab's straight line and the bent one meet: about that of the hover


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargeTransfer(Effect):
    """V_ct = (2 R_g T / F) asinh(i / 2 i_0), slower than in the lab, or in the place of its straight line.

    Where the lab's recordings told charge transfer from the rest, it is the battery's ``double-layer``, and only its
    speed is open. Where they did not, it is within the resistance, which was identified around the load of a hover: of
    the straight line that is replaced a share of the chord up to 2C is the kinetics as the lab had them. At that speed
    the effect bends the drop but does not change it there; since then they may have become slower. At one temperature
    nothing makes them faster: what wants that is the lab's model, not the pack. That holds for Chem too: what its
    exchange currents are after an identification is as often polarisation that takes a minute.

    A cell has two electrodes. The faster one's drop is straight as long as it is fast, so the lab has it for ohmic.
    When both become slower it bends as well, and no such line is the sum of two.
    """

    id: ClassVar[str] = "charge-transfer"
    title: ClassVar[str] = "Charge transfer is not as in the lab's model"
    equation: ClassVar[str] = (
        "V_ct = (2 R_g T / F) [asinh(i / 2 s i_0) + asinh(i / 2 s i_u)], i_0 the double layer's or w of it in the "
        "lab's chord up to 2C, i_u of a share u of the lab's ohmic drop there"
    )
    source: ClassVar[str] = "Butler-Volmer with alpha = 0.5, Daigle & Kulkarni 2013; i_0 0.12-1.2 C"
    excited_by: ClassVar[str] = "loads from rest to full throttle at one charge"
    mimics: ClassVar[tuple[str, ...]] = (
        "resistance-temperature", "resistance-growth", "contact-resistance", "core-lag", "current-gain",
    )  # fmt: skip
    manoeuvre: ClassVar[str] = "a staircase of three throttle levels, 5 s each, at one charge"

    bend: Value = parameter(
        "1C / i_0", "1", 0.1, 100.0, "current of one hour's discharge over the lab's exchange current", default=0.0,
        prior=(2.5, 2.5), unless="double-layer",
    )  # fmt: skip
    straight: Value = parameter(
        "w", "1", 0.0, 2.0, "share of the bent line that the lab's straight one stands for", default=0.0,
        absent=0.0, prior=(1.0, 0.5), unless="double-layer",
    )  # fmt: skip
    speed: Value = parameter(
        "s", "1", 0.05, 1.0, "speed of charge transfer over that of the lab", default=1.0, absent=1.0,
        prior=(1.0, 0.4),
    )  # fmt: skip
    other: Value = parameter(
        "u", "1", 0.0, 1.0, "share of the lab's ohmic drop at 2C that is charge transfer of the other electrode",
        default=0.0, prior=(0.2, 0.2),
    )  # fmt: skip

    def modifiers(self, state: tuple[Value, ...], at: Conditions) -> Modifiers:
        return Modifiers(transfer=self.speed)

    def extra_voltage(self, state: tuple[Value, ...], now: Instant) -> Value:
        rate = now.cell_current * (SECONDS_PER_HOUR / now.cell.capacity_c)  # in C
        more = further_drop(rate, self.bend / now.by.kinetics, self.straight, self.speed)
        other = other_bend(self.other, ohmic_chord(now.cell, now.by, now.temperature))
        more = more + further_drop(rate, other, 0.0, self.speed)
        added: Value = now.series * (2.0 * GAS_CONSTANT / FARADAY) * now.temperature * -more
        return added


def further_drop(rate: Value, bend: Value, straight: Value, speed: Value) -> Value:
    """What the drop is larger by than the lab's at a load ``rate`` [1/h], of a cell, in 2 R_g T / F; see the effect."""
    half = 0.5 * bend
    lab = np.arcsinh(half * rate)
    chord = rate * (np.arcsinh(half * _CHORD_C) / _CHORD_C)
    larger: Value = np.arcsinh(half * rate / speed) - lab - straight * (chord - lab)
    return larger


def ohmic_chord(cell: CellModel, by: Modifiers, temperature: Value) -> Value:
    """The ohmic drop of a cell at 2C, in 2 R_g T / F."""
    drop_v = cell.ohmic_resistance(by) * cell.capacity_c * (_CHORD_C / SECONDS_PER_HOUR)
    chord: Value = drop_v / ((2.0 * GAS_CONSTANT / FARADAY) * temperature)
    return chord


def other_bend(share: Value, chord: Value) -> Value:
    """The other electrode's 1C / i_u, where its line meets a share of the `ohmic_chord` at 2C; see the effect."""
    bend: Value = 2.0 * np.sinh(share * chord) / _CHORD_C
    return bend
