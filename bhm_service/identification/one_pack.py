"""Whether recordings are of one pack: by the charge between their rests before a fit, by their errors after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bhm_service.errors import BadInputError
from bhm_service.identification.assess import Assessment
from bhm_service.identification.experiment import Experiment, Kind
from bhm_service.identification.premises import Premises
from bhm_service.units import SECONDS_PER_HOUR

FOREIGN_V, _FOREIGN_RATIO = 0.05, 6.0  # a recording this much worse than the others is of another pack
_MORE = 1.08  # times the capacity: a warm cell under load gives a little more than a slow discharge counted
_AGED = 0.2  # a cell may have lost this between its recordings, not more
_RESTED_S = 300.0
_LEAST_FALL = 0.2  # of state of charge between two rests, to divide by
_HINT = "is it of another pack, or of another number of cells (--series)? Leave it out, or identify it alone"


def contradiction(experiments: Sequence[Experiment], premises: Premises) -> BadInputError | None:
    """What is to be said of a recording whose charge is not that of the pack of the slow discharge."""
    if not any(e.kind is Kind.SLOW for e in experiments):
        return None
    known_ah = premises.capacity_c / SECONDS_PER_HOUR
    for e in experiments:
        out_ah = float(np.max(e.charge_c)) / SECONDS_PER_HOUR
        if out_ah > _MORE * known_ah:
            return BadInputError(e.label, f"takes out {out_ah:.3g} Ah, of a pack that has {known_ah:.3g} Ah", _HINT)
        own_ah = _between_rests_ah(e, premises)
        if own_ah is not None and abs(np.log(own_ah / known_ah)) > _AGED:
            return BadInputError(
                e.label,
                f"takes out {out_ah:.3g} Ah between rests whose voltages say that its pack has {own_ah:.3g} Ah, not "
                f"{known_ah:.3g} Ah",
                _HINT,
            )
    return None


def _between_rests_ah(experiment: Experiment, premises: Premises) -> float | None:
    begin, loaded = experiment.rest_before, np.flatnonzero(experiment.loaded)
    if experiment.kind is Kind.SLOW or begin is None or loaded.size == 0:
        return None
    last = int(loaded[-1])
    after = experiment.voltage_v[last + 1 :][experiment.measured[last + 1 :]]
    if after.size == 0 or experiment.time_s[-1] - experiment.time_s[last] < _RESTED_S:
        return None
    soc = np.linspace(0.0, 1.03, 1031)
    high, low = np.interp([begin, float(after[-1])], np.asarray(premises.curve.voltage(soc)), soc)
    if high - low < _LEAST_FALL:
        return None
    return float(experiment.charge_c[-1]) / SECONDS_PER_HOUR / float(high - low)


def foreign(assessments: Sequence[Assessment]) -> BadInputError | None:
    """What is to be said of the recording that fits the cell of all others worst, if it is of another pack."""
    errors = np.array([a.whole.rmse for a in assessments])
    if np.isfinite(errors).sum() < 2:
        return None
    k = int(np.nanargmax(errors))
    others = float(np.nanmedian(np.delete(errors, k)))
    if errors[k] <= max(FOREIGN_V, _FOREIGN_RATIO * others):
        return None
    return BadInputError(
        assessments[k].label,
        f"does not fit the pack of the other recordings: it is off by {1e3 * errors[k]:.0f} mV a cell, "
        f"they by {1e3 * others:.0f} mV",
        _HINT,
    )
