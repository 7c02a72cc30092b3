"""Where fits come to rest."""

from __future__ import annotations

from pathlib import Path

import pytest
from identification.test_accuracy import three

from bhm_service.identification.families import ChemFamily
from bhm_service.identification.premises import premises_of, problem_for
from bhm_service.identification.solve import solve


def test_a_fit_does_not_creep_along_the_coefficients_of_a_series(data: Path) -> None:
    folder = data.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"simulated cases are not here: {folder}")
    experiments = [e.without_onset().thinned(500) for e in three(folder, "fade")]
    premises = premises_of(experiments, None)
    family = ChemFamily(capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=premises.curve_sd)
    problem = problem_for(family, experiments, premises)
    starts = family.elsewhere(problem.unknowns, solve(problem).x)
    costs = sorted(solve(problem, starts=[x]).cost for x in starts)
    # There are two valleys; what reaches the deeper one comes down to its bottom, each from its own side.
    assert costs[3] < costs[0] * (1.0 + 2e-4), costs
