"""The vehicle as its maker knows it: a file of its figures, each to within what one knows of it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sim.concealed.load import DRAG_M2, PROFILE, flies
from sim.concealed.packs import Pack
from sim.concealed.sheets import CaseSheet

_STANDARD_DENSITY = 1.225
_G = 9.80665
# One standard deviation of what a maker knows: scales, a hover on the bench, a meter, forward flight in a book.
_MASS_SD, _HOVER_SD, _AVIONICS_SD, _TERM_SD, _DRAG_SD = 0.02, 0.04, 0.10, 0.05, 0.15


def vehicle_file(sheet: CaseSheet, pack: Pack) -> str:
    """The text of `vehicle.toml`. Its demand model lacks the terms that the case conceals, and holds the others."""
    rng = sheet.generator("vehicle")
    mass_kg, disc_m2 = flies(pack)
    told_kg = mass_kg * (1.0 + rng.normal(0.0, _MASS_SD))
    avionics_w = pack.avionics_w * (1.0 + rng.normal(0.0, _AVIONICS_SD))
    hover_w = (pack.hover_w - pack.avionics_w) * (1.0 + rng.normal(0.0, _HOVER_SD))
    rotors = int(rng.choice([4, 6, 8]))
    ideal_w = (told_kg * _G) ** 1.5 / np.sqrt(2.0 * _STANDARD_DENSITY * disc_m2)
    induced = 1.0 - PROFILE
    climb, lift = induced * (1.0 + rng.normal(0.0, _TERM_SD, 2))
    drag_m2 = DRAG_M2 * mass_kg**0.67 * (1.0 + rng.normal(0.0, _DRAG_SD))
    lines = [
        'name = "as its maker knows it"',
        "[battery]",
        'file = "battery.toml"',
        "[rotors]",
        f"mass_kg = {told_kg:.3f}",
        f"rotors = {rotors}",
        f"rotor_radius_m = {np.sqrt(disc_m2 / rotors / np.pi):.4f}",
        f"efficiency = {ideal_w / hover_w:.4f}",
        f"avionics_w = {avionics_w:.1f}",
        *_term("climb-power", "induced", climb, _TERM_SD * induced, sheet),
        *_term("translational-lift", "induced", lift, _TERM_SD * induced, sheet),
        *_term("wind-tilt", "drag_area", drag_m2, _DRAG_SD * drag_m2, sheet),
    ]
    return "\n".join(lines) + "\n"


def _term(name: str, parameter: str, value: float, sd: float, sheet: CaseSheet) -> Collection[str]:
    if any(effect.name == name for effect in sheet.effects):
        return ()
    return "[[demand]]", f'id = "{name}"', f"{parameter} = {{ value = {value:.4f}, sd = {sd:.4f} }}"
