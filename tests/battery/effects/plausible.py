"""An effect of every kind at a plausible size, and a load that shows it."""

from __future__ import annotations

import numpy as np

from bhm_service.battery.effects import EFFECTS, Effect, ResistanceTemperature

# What priors do not say: times of a fault, a covariate of the flight, what a lab tells.
GIVEN = {
    "intermittent-contact": {"begin": 120.3, "end": 300.7},
    "self-discharge": {"storage": 12 * 86400.0},
    "capacity-fade": {"age": 1.3},
    "graphite-lag": {"time_constant": 200.0, "steepness": 3.0, "share": 1.0, "empty": 0.02, "full": 0.85},
    "surface-lag": {"time_constant": 120.0, "share": 1.0},
    "self-heating": {"ambient": 281.0, "start_above": 5.0, "heat_capacity": 450.0, "conductance": 1.2},
}
SIGNED = 1.3  # standard deviations from nothing, for sizes that may have both signs


def sizes(effect: type[Effect]) -> dict[str, float]:
    """SI sizes of its parameters: the prior's mean, off its absent value by more than a little."""
    found = {}
    for p in effect.parameters():
        if p.prior is not None:
            mean, sd = p.prior
            more, less = (mean + sign * SIGNED * sd for sign in (1.0, -1.0))
            found[p.name] = p.si((more if more <= p.high else less) if mean == p.absent else mean)
    return found | GIVEN.get(effect.id, {})


def joined(effect: type[Effect], **sizes_: object) -> list[Effect]:
    """The effect with those that it is shown by."""
    others = [ResistanceTemperature(activation_energy=24e3)] if effect.shown_by else []
    return [*others, effect(**sizes_)]


def hover(length: int = 600, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], current [A] of a 5 Ah pack and a temperature [K] that rises; uneven steps, rests and bursts."""
    rng = np.random.default_rng(seed)
    t = np.concatenate([[0.0], np.cumsum(rng.choice([0.5, 1.0, 3.0], length - 1))])
    current = np.where((t // 40) % 7 == 5, 0.0, 11.0 + 3.0 * rng.standard_normal(length))
    return t, current, 278.0 + 16.0 * t / t[-1]


ALL = list(EFFECTS.values())
IDS = list(EFFECTS)
