"""Both sides of an explanation as one `findings.json`: what voltage says and what power says."""

from __future__ import annotations

from bhm_service.discrepancy.demand_side import DemandSide, NotLooked
from bhm_service.discrepancy.findings import Findings, Verdict
from bhm_service.prediction.demand_effects import DEMAND_EFFECTS


def joined_findings(battery: Findings, demand: DemandSide | NotLooked) -> Findings:
    """The battery's findings with those of the demand; as they are where the demand was not looked at."""
    if isinstance(demand, NotLooked):
        return battery
    volts, watts = [e.id for e in battery.effects], [e.id for e in demand.effects]
    alternatives = [[*names, *watts] for names in battery.alternatives]
    alternatives += [[*volts, *names] for names in demand.alternatives]
    steps = [*battery.change_points, *demand.change_points]
    return battery.model_copy(
        update={
            "verdict": _verdict(battery.verdict, demand.verdict),
            "effects": [*battery.effects, *demand.effects],
            "alternatives": [sorted(names) for names in alternatives],
            "unexplained_rest": max(battery.unexplained_rest, demand.rest),
            "change_points": sorted(steps, key=lambda c: (c.flight, c.time_s)),
            "advice": [*battery.advice, *_advice(demand)],
        }
    )


def _verdict(battery: Verdict, demand: Verdict) -> Verdict:
    """Ambiguous if either side is, named if either names; else what either side has to say."""
    for strong in ("ambiguous", "named", "sensor-suspect", "unknown", "parameter"):
        if strong in (battery, demand):
            return strong
    return battery


def _advice(demand: DemandSide) -> list[str]:
    """For what the flights cannot tell apart, the catalogue's manoeuvre."""
    rivals = {name for names in demand.alternatives for name in names} | {e.id for e in demand.effects}
    if demand.verdict == "parameter":
        rivals = {"payload-mass"}
    elif demand.verdict != "ambiguous":
        return []
    return sorted({DEMAND_EFFECTS[name].manoeuvre for name in rivals})
