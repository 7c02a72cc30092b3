import pytest

pytest.importorskip("pybamm", reason="PyBaMM is not here: pip install 'bhm-service[truth]'")

from sim.multirotor import Multirotor, hover_plan
from sim.pybamm_pack import PybammPack


def test_the_electrochemical_pack_sags_under_load_and_ends():
    pack = PybammPack(series=4, capacity_ah=5.0, left=0.95)
    vehicle = Multirotor(pack, hover_plan(160.0, 2500.0), 1)
    states = []
    while (state := vehicle.second()) is not None and state.voltage_v > 10.0:
        states.append(state)
    rest, loaded = states[3].voltage_v, states[30].voltage_v
    assert 16.0 < rest < 16.9
    assert 0.1 < rest - loaded < 1.5
    assert 0.6 * 5.0 < states[-1].consumed_ah < 5.0
    assert states[-1].airborne
