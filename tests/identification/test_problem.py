"""Derivatives of a fit's residuals against plain differences of them."""

from __future__ import annotations

import numpy as np
import pytest
from battery.cells import CAPACITY_C, circ
from identification.known import one_c, slow, variable

from bhm_service.battery.pack import PackModel
from bhm_service.identification.extras import Extras
from bhm_service.identification.families import ChemFamily, CircFamily
from bhm_service.identification.premises import premises_of, problem_for
from bhm_service.identification.problem import STEP


@pytest.mark.parametrize(
    ("make", "form", "surface"),
    [
        (CircFamily, {}, False), (CircFamily, {}, True), (CircFamily, {"ocv": "cubic"}, False),
        (CircFamily, {"ocv": "cubic"}, True), (ChemFamily, {}, False), (ChemFamily, {"with_rest": True}, False),
    ],
    ids=["spline", "spline that lags", "cubic", "cubic that lags", "chem", "chem with what its series leaves"],
)  # fmt: skip
def test_derivatives_are_differences_of_the_residuals(make, form, surface):
    rng = np.random.default_rng(1)
    pack = PackModel(circ(), 1)
    experiments = [run(pack, rng).thinned(100) for run in (slow, one_c, variable)]
    premises = premises_of(experiments, CAPACITY_C / 3600.0)
    extras = Extras(slow=True, surface=surface)
    family = make(capacity_c=premises.capacity_c, curve=premises.curve, curve_sd=0.01, extras=extras, **form)
    problem = problem_for(family, experiments, premises)
    x = problem.unknowns.start
    rows = problem.residuals(np.vstack([x, x + STEP * np.eye(x.size)]))
    plain = (rows[1:] - rows[0]).T / STEP
    residual, jacobian = problem.linearised(x, np.arange(x.size))
    assert residual == pytest.approx(rows[0], rel=1e-12, abs=1e-12)
    assert jacobian == pytest.approx(plain, rel=1e-9, abs=1e-6)
    some = np.array([0, 3, x.size - 1])
    assert problem.linearised(x, some)[1] == pytest.approx(plain[:, some], rel=1e-9, abs=1e-6)
