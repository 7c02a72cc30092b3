"""Cells with round numbers, for comparing with closed forms."""

from __future__ import annotations

from bhm_service.battery.chem import Chem
from bhm_service.battery.circ import Circ
from bhm_service.battery.ocv import CubicCapacitance, MonotoneSpline

CAPACITY_C = 5.0 * 3600.0

CURVE = MonotoneSpline((0.0, 0.1, 0.2, 0.5, 0.8, 1.0), (3.2, 3.6, 3.72, 3.82, 4.0, 4.2))
CUBIC = CubicCapacitance(c_max=CAPACITY_C, q_max=1.02 * CAPACITY_C, v_0=4.2, cbp0=-2000.0, cbp1=3000.0, cbp2=2500.0)


def circ(**changes: object) -> Circ:
    numbers: dict[str, object] = {
        "ocv": CURVE, "c_max": CAPACITY_C, "r_s": 0.004, "r_sp0": 0.003, "r_sp1": 1e-5, "r_sp2": 6.0, "c_sp": 5000.0,
    }  # fmt: skip
    return Circ(**(numbers | changes))  # type: ignore[arg-type]


def chem(**changes: object) -> Chem:
    numbers: dict[str, object] = {
        "q_max": CAPACITY_C / 0.6, "u_0": 4.03, "surface_fraction": 0.1, "t_diffusion": 140.0, "r_o": 0.004,
        "tau_o": 2.0, "i_p0": 20.0, "i_n0": 60.0, "tau_p": 30.0, "tau_n": 8.0,
        "a_p": (-31593.7, 106747.0, 24606.4, -78561.9, 13317.9, 307387.0), "a_n": (86.19,),
    }  # fmt: skip
    return Chem(**(numbers | changes))  # type: ignore[arg-type]
