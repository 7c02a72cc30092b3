"""A withheld channel against what was inferred for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim.proof.scoring.answers import Series

_CLOCK_S = 1e8  # times above are of a clock of 1970, below they count from the beginning of a log
_FEWEST = 5
Array: TypeAlias = NDArray[np.float64]


def since_start(time_s: float, start_s: float) -> float:
    """A time in either clock as seconds since the log's first sample."""
    return time_s - start_s if time_s > _CLOCK_S else time_s


def stem(flight: str) -> str:
    """A flight's name without folder and endings, as both sides know it."""
    return flight.rsplit("/", 1)[-1].split(".", 1)[0]


def compare(
    withheld: Mapping[str, Series], inferred: Mapping[str, Series], starts_s: Mapping[str, float]
) -> tuple[dict[str, float], list[str]]:
    """Measures ``hidden.<quantity>.{rmse,bias,r,change_rmse,rise_error}`` over all flights, and why any is missing.

    r and change_rmse are of the changes since each flight's first sample, so that an ambient that is guessed right does
    not earn them; rise_error is the difference of the largest rises, the median over flights.
    """
    measures: dict[str, float] = {}
    missing: list[str] = []
    names = {stem(flight): of for flight, of in inferred.items()}
    quantities = sorted({q for of in withheld.values() for q in of if q != "time_s"})
    for quantity in quantities:
        pairs = []
        for flight, truth in withheld.items():
            given = names.get(stem(flight))
            if given is None or quantity not in given or "time_s" not in given or quantity not in truth:
                missing.append(f"hidden.{quantity}: not inferred for {flight}")
                continue
            pair = _at_same_times(truth, given, quantity, starts_s.get(flight, 0.0))
            if pair is None:
                missing.append(
                    f"hidden.{quantity}: {flight} shares fewer than {_FEWEST} instants with what is inferred"
                )
                continue
            pairs.append(pair)
        if not pairs:
            continue
        true, found = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
        measures[f"hidden.{quantity}.rmse"] = float(np.sqrt(np.mean((found - true) ** 2)))
        measures[f"hidden.{quantity}.bias"] = float(np.mean(found - true))
        moved_true, moved_found = (np.concatenate([pair[k] - pair[k][0] for pair in pairs]) for k in (0, 1))
        measures[f"hidden.{quantity}.change_rmse"] = float(np.sqrt(np.mean((moved_found - moved_true) ** 2)))
        if np.std(moved_true) > 0.0 and np.std(moved_found) > 0.0:
            measures[f"hidden.{quantity}.r"] = float(np.corrcoef(moved_true, moved_found)[0, 1])
        else:
            missing.append(f"hidden.{quantity}.r: one of the two does not move")
        rises = [float(np.max(f - f[0]) - np.max(t - t[0])) for t, f in pairs]
        measures[f"hidden.{quantity}.rise_error"] = float(np.median(np.abs(rises)))
    return measures, missing


def _at_same_times(truth: Series, given: Series, quantity: str, start_s: float) -> tuple[Array, Array] | None:
    """Both at the withheld channel's own instants."""
    t, y = np.array(truth["time_s"]), np.array(truth[quantity])
    u, z = np.array([since_start(x, start_s) for x in given["time_s"]]), np.array(given[quantity])
    known = np.isfinite(u) & np.isfinite(z)
    u, z = u[known], z[known]
    if t.size == 0 or u.size < 2:
        return None
    inside = (t >= u[0]) & (t <= u[-1]) & np.isfinite(y)
    if inside.sum() < _FEWEST:
        return None
    return y[inside], np.interp(t[inside], u, z)
