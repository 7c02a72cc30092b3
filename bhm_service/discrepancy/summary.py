"""What a decision comes to, as `findings.json` has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bhm_service.discrepancy import verdict
from bhm_service.discrepancy.changed_lag import ChangedLag
from bhm_service.discrepancy.confirm import HeldOut
from bhm_service.discrepancy.decision import Decision
from bhm_service.discrepancy.explanation import Course, Left
from bhm_service.discrepancy.findings import ChangePoint, EffectFound, Findings, Fit, Inferred, Region
from bhm_service.discrepancy.fitting import Fitted
from bhm_service.discrepancy.locate import locate
from bhm_service.discrepancy.onset import first_flight
from bhm_service.discrepancy.quantities import parameters
from bhm_service.discrepancy.search import Search, by_members
from bhm_service.units import Array


def findings_of(
    found: Search,
    decision: Decision,
    fits: Sequence[Fitted],
    courses: Sequence[Course],
    proof: HeldOut | None,
    judged: verdict.Judged,
    advised: Sequence[str],
) -> Findings:
    """The findings of the battery's side; ``fits`` are of the set that stands, with its own model of the cell first."""
    fitted = fits[0]
    chosen, rivals = decision.chosen, decision.contests
    misfits = [c.flight.voltage_v - c.before_v for c in courses]
    before, after = _rms(misfits), _rms([c.flight.voltage_v - c.after_v for c in courses])
    explained = max(1.0 - (after / max(before, 1e-9)) ** 2, 0.0)
    shares = shares_of(fitted, courses)
    beaten = float(np.mean([c.beaten for c in rivals])) if rivals else None
    effects = [
        EffectFound(
            id=member.id,
            parameters=parameters(fits, member.id),
            evidence_nats=float(chosen.earned[member.id]),
            p_familywise=decision.p_values[member.id],
            share_of_misfit=explained * shares[member.id],
            decoys_beaten=beaten if member.driven_by_temperature else None,
        )
        for member in sorted(fitted.joint.members, key=lambda m: -chosen.added_v[m.id])
    ]
    regions = []
    if judged.verdict != "none":
        regions = locate(misfits, [c.flight for c in courses], [c.soc for c in courses], found.noise.sigma_v)
    return Findings(
        verdict=judged.verdict,
        effects=effects,
        alternatives=[sorted(names) for names in chosen.alternatives],
        unexplained_rest=judged.rest,
        localisation=[
            Region(
                where=r.where,
                flights=list(r.flights),
                share_of_misfit=min(r.share_of_misfit, 1.0),
                sign=1 if r.sign > 0 else -1,
            )
            for r in regions
        ],
        change_points=change_points(fitted, decision.left),
        inferred=[
            Inferred(flight=c.flight.label, file=f"hidden/{c.flight.label}.csv", states=sorted(c.hidden))
            for c in courses
            if c.hidden
        ],
        fit=Fit(
            rmse_before_V=before,
            rmse_after_V=after,
            heldout_before_V=None if proof is None else proof.before_v,
            heldout_after_V=None if proof is None else (proof.after_v if chosen.names else proof.before_v),
            noise_floor_V=found.noise.sigma_v,
        ),
        advice=list(advised),
        battery_file=None,
    )


def shares_of(fitted: Fitted, courses: Sequence[Course]) -> dict[str, float]:
    """Of the power by which the voltage is moved, each member's; the rest is what the lab left open."""
    if not fitted.joint.members:
        return {}
    parts = by_members(fitted.joint, fitted.x)
    moved = np.concatenate([c.after_v - c.before_v for c in courses])
    power = np.mean(np.vstack([parts, moved - parts.sum(axis=0)]) ** 2, axis=1)
    return {m.id: float(own / power.sum()) for m, own in zip(fitted.joint.members, power, strict=False)}


def _rms(parts: Sequence[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate(parts) ** 2)))


def change_points(fitted: Fitted, left: Left | None = None) -> list[ChangePoint]:
    """Where something began or changed: members with an onset, contacts, and a lag that is left; in their order."""
    found = []
    if isinstance(left, ChangedLag):
        found.append(ChangePoint(flight=left.flight, time_s=0.0))
    for member in fitted.joint.members:
        if first := first_flight(member):
            found.append(ChangePoint(flight=fitted.joint.flights[first].label, time_s=0.0))
        for key, told in member.fixed.items():
            if not key.startswith("intermittent-contact#"):
                continue
            for k, time_s in enumerate(told):
                if 0.0 < time_s < float(fitted.joint.flights[k].time_s[-1]):
                    found.append(ChangePoint(flight=fitted.joint.flights[k].label, time_s=float(time_s)))
    return sorted(found, key=lambda c: (c.flight, c.time_s))
