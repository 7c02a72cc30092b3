"""A whole explanation of three flights of the small pack, one of them cold, put together by hand."""

from __future__ import annotations

import numpy as np
from discrepancy.made import BATTERY, course, flight, flown, lab, searched, si

from bhm_service.discrepancy.candidate import NotExcited
from bhm_service.discrepancy.confirm import HeldOut, LeftOutFlight
from bhm_service.discrepancy.explanation import Contest, Course, Explanation, Flying
from bhm_service.discrepancy.findings import EffectFound, Findings, Fit, Quantity, Region
from bhm_service.discrepancy.flights import LeftOut
from bhm_service.discrepancy.locate import regime_maps, variables
from bhm_service.discrepancy.selection import Selection
from bhm_service.discrepancy.words import effect_in_words, sentence

NAME, RIVAL, MIMIC = "resistance-temperature", "contact-resistance", "resistance-growth"


def explanation() -> Explanation:
    """Resistance follows temperature; a rival is ruled out, another one is not much worse."""
    truth = [si(NAME, {"activation_energy": 22.0})]
    flights = [flown(flight(k, celsius), truth, k) for k, celsius in ((1, 4.0), (2, 15.0), (3, 26.0))]
    courses = [course(f, truth) for f in flights]
    found = findings()
    off = np.concatenate([c.flight.voltage_v - c.before_v for c in courses])
    return Explanation(
        lab=lab(),
        battery=BATTERY,
        repaired=None,
        courses=courses,
        left_out=[LeftOut("hop.tlog", "lasts 41 s, 60 s are needed")],
        search=searched(flights, {(): 2000.0, (NAME,): 1140.0, (RIVAL,): 1900.0, (MIMIC,): 1158.0}),
        selection=Selection(frozenset({NAME}), (), {NAME: 430.0}, {NAME: 0.3}),
        held_out=HeldOut(tuple(_held_out(c) for c in courses)),
        maps=regime_maps(off, variables(flights, [c.soc for c in courses])),
        contests=[Contest("time in the air", 55.0, True), Contest("charge used", 2.0, False)],
        not_excited=[
            NotExcited("self-heating", "temperature is recorded"),
            NotExcited("weak-cell", "of its usual size it would stand 1.2 sigma out of noise and lab errors"),
        ],
        flying=[Flying("01.tlog", 700.0, 640.0), Flying("02.tlog", 700.0, 690.0), Flying("03.tlog", 700.0, 701.0)],
        sentence=sentence(found, 3),
        in_words=[effect_in_words(NAME, {"activation_energy": 21.7}, lab(), flights, courses)],
        findings=found,
    )


def findings() -> Findings:
    """What goes with it."""
    return Findings(
        verdict="named",
        effects=[
            EffectFound(
                id=NAME,
                parameters={"activation_energy": Quantity(value=21.7, sd=0.83, unit="kJ/mol")},
                evidence_nats=430.0,
                p_familywise=0.005,
                share_of_misfit=0.93,
                decoys_beaten=0.5,
            )
        ],
        alternatives=[],
        unexplained_rest=0.0,
        localisation=[Region(where={"temperature_C": (3.0, 10.0)}, flights=["01.tlog"], share_of_misfit=0.81, sign=-1)],
        change_points=[],
        inferred=[],
        fit=Fit(
            rmse_before_V=0.31, rmse_after_V=0.01, heldout_before_V=0.402, heldout_after_V=0.013, noise_floor_V=0.01
        ),
        advice=[],
        battery_file="battery.toml",
    )


def _held_out(told: Course) -> LeftOutFlight:
    begin = told.flight.time_s.size // 4
    tuned = 0.5 * (told.before_v + told.after_v)
    return LeftOutFlight(
        told.flight.label, told.before_v, tuned, told.after_v - 0.02, told.flight.voltage_v, begin
    )  # fmt: skip
