"""Flights side by side, padded to one length, so that one run of the model takes them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from bhm_service.battery.dynamics import Follower
from bhm_service.discrepancy.flights import FlightData, at_skew
from bhm_service.discrepancy.lab import followed
from bhm_service.units import Array, Flags, Places

_KEPT = 64  # sets of flights: every search has few, but comes back to them for every fit


@dataclass(frozen=True, eq=False)
class Abreast:
    """F flights along one axis of T samples; what is beyond a flight's end stands still and is never looked at."""

    places: Places  # (F,) of the flights among all
    flights: tuple[FlightData, ...]

    @cached_property
    def sizes(self) -> Places:
        """Samples of each flight."""
        return np.array([f.time_s.size for f in self.flights])

    def padded(self, series: Sequence[Array]) -> Array:
        """One series of every flight, with its last value repeated; (F, T)."""
        found = np.empty((len(series), int(self.sizes.max())))
        for row, own in zip(found, series, strict=True):
            row[: own.size] = own
            row[own.size :] = own[-1]
        return found

    @cached_property
    def time_s(self) -> Array:
        """(F, T)."""
        return self.padded([f.time_s for f in self.flights])

    @cached_property
    def current_a(self) -> Array:
        """Measured, (F, T)."""
        return self.padded([f.current_a for f in self.flights])

    @cached_property
    def voltage_v(self) -> Array:
        """(F, T); not a number where none was read."""
        return self.padded([f.voltage_v for f in self.flights])

    @cached_property
    def unread(self) -> Flags:
        """Where that is; (F, T)."""
        return ~np.isfinite(self.voltage_v)

    @cached_property
    def temperature_k(self) -> Array | None:
        """(F, T); of all of them or of none."""
        known = [f.temperature_k for f in self.flights if f.temperature_k is not None]
        return self.padded(known) if known else None

    @cached_property
    def followed_a(self) -> Array:
        """The current as each relaxation of the lab's drop follows it, (relaxations, F, T)."""
        return followed(self.time_s, self.current_a)

    @cached_property
    def _shifts_a(self) -> Array:
        """The current at each of `SHIFTS_S` beside its own instant; (shifts, F, T)."""
        return np.stack([self.padded(rows) for rows in zip(*(f.shifted_a for f in self.flights), strict=True)])

    @cached_property
    def _shifts_followed_a(self) -> Array:
        """Each of those as `followed_a`; (relaxations, shifts, F, T)."""
        return followed(self.time_s, self._shifts_a)

    def current_at(self, skew_s: Array) -> Array:
        """The current so much later than it was told, one number for all flights (M,); (M, F, T)."""
        return np.tensordot(at_skew(skew_s), self._shifts_a, axes=1)

    def followed_at(self, skew_s: float) -> tuple[Array, Array]:
        """The current as each relaxation of the lab's drop follows it, and itself, at one skew."""
        if skew_s == 0.0:
            return self.followed_a, self.current_a
        weights = at_skew(np.array([skew_s]))[0]
        return np.einsum("s,rsft->rft", weights, self._shifts_followed_a), np.tensordot(weights, self._shifts_a, axes=1)

    @cached_property
    def lightness(self) -> Array:
        """How far the load is below the flight's usual one, in shares of it within one; (F, T)."""
        usual = np.array([[float(np.mean(np.abs(f.current_a))) + 1e-9] for f in self.flights])
        return np.asarray(np.clip(1.0 - np.abs(self.current_a) / usual, -1.0, 1.0))

    @cached_property
    def sudden_a(self) -> Array:
        """As `sudden` of the current; (F, T)."""
        return sudden(self.current_a)

    def lag(self, tau_s: float) -> Follower:
        """What follows a series of the flights (.., F, T) with a time constant, from rest."""
        if tau_s not in self._lags:
            self._lags[tau_s] = Follower(np.diff(self.time_s), tau_s)
        return self._lags[tau_s]

    @cached_property
    def _lags(self) -> dict[float, Follower]:
        return {}


def sudden(current_a: Array) -> Array:
    """Changes of a current (.., T) as fast as its samples, at both samples that they may be read in."""
    change = np.abs(np.diff(current_a, axis=-1, prepend=current_a[..., :1]))
    change[..., 1:] = np.maximum(change[..., 1:], change[..., :-1])
    return change


@lru_cache(maxsize=_KEPT)
def abreast(flights: tuple[FlightData, ...]) -> tuple[Abreast, ...]:
    """The flights in groups that one run can take: those with a temperature, and those without."""
    found = []
    for known in (True, False):
        places = np.array([k for k, f in enumerate(flights) if (f.temperature_k is not None) is known], dtype=np.intp)
        if places.size:
            found.append(Abreast(places, tuple(flights[k] for k in places)))
    return tuple(found)
