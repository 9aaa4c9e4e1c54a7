"""A plate that swings across the water: published drag and inertia, and what mjfish's forces come out at.

[Keulegan1958] G. H. Keulegan, L. H. Carpenter: Forces on cylinders and plates in an oscillating fluid, J. Res. Nat.
    Bur. Standards 60.
[Graham1980] J. M. R. Graham: The forces on sharp-edged cylinders in oscillatory flow at low Keulegan-Carpenter numbers,
    J. Fluid Mech. 97.
[Luhar2016] M. Luhar, H. Nepf: Wave-induced dynamics of flexible blades, J. Fluids Struct. 61; the fit as it stands in
    [Zhu2021] L. Zhu and others, Coastal Eng. 168, 103947.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from scipy import optimize

from mjfish import StripFluid
from mjfish.effects import find

#: Keulegan-Carpenter number and drag coefficient of plates, twelve of the runs of [Keulegan1958], Table 4.
PLATES = (
    (1.7, 11.55),
    (2.2, 10.21),
    (3.5, 8.81),
    (5.2, 7.06),
    (7.5, 5.15),
    (7.7, 5.48),
    (8.8, 5.21),
    (13.6, 4.28),
    (16.3, 4.11),
    (29.9, 3.36),
    (62.2, 2.43),
    (118.2, 1.81),
)
#: Keulegan-Carpenter number at which mjfish states c_d.
KC_0 = 3.0
#: Numbers at which inertia is compared, and the stretch on which mjfish's law is fitted: there the plates' rises.
INERTIA_KC = (2.0, 4.0, 8.0, 12.0, 18.0)
RISING = (1.7, 8.0)
_DENSITY, _HEIGHT, _LENGTH, _PERIOD = 1000.0, 0.1, 0.3, 1.0
_CARRIAGE, _STEPS, _SETTLE, _FIT = 1e6, 500, 8, 4


def graham(kc: float) -> float:
    """Return the drag coefficient of a flat plate, 8 KC^(-1/3) [Graham1980]."""
    return float(8.0 * kc ** (-1.0 / 3.0))


def luhar_inertia(kc: float) -> float:
    """Return the inertia coefficient of a plate, a fit to [Keulegan1958] and others for KC = 1.7 to 118 [Luhar2016].

    It is the smaller of 1 + 0.35 KC^(2/3) (0.15 from KC = 20 on) and 1 + (KC - 18)^2 / 49.
    """
    return float(min(1.0 + (0.35 if kc < 20.0 else 0.15) * kc ** (2.0 / 3.0), 1.0 + (kc - 18.0) ** 2 / 49.0))


@functools.cache
def drag_law() -> tuple[float, float]:
    """Return c_d at KC = 3 and the power n of c_d (KC / 3)^-n through the published plates, by logarithms."""
    kc, c_d = np.log(np.array(PLATES)).T
    slope, at_one = np.polynomial.Polynomial.fit(kc - np.log(KC_0), c_d, 1).convert().coef[::-1]
    return float(np.exp(at_one)), float(-slope)


def misfit(c_d: float, power: float) -> float:
    """Return the root mean square of the law's relative difference from the published plates."""
    kc, measured = np.array(PLATES).T
    return float(np.sqrt(np.mean((c_d * (kc / KC_0) ** -power / measured - 1.0) ** 2)))


@functools.cache
def inertia_law() -> tuple[float, float]:
    """Return loss and half of `added_mass_amplitude` through [Luhar2016] over `RISING`, within the effect's bounds."""
    kc = np.geomspace(*RISING, 40)
    published = np.array([luhar_inertia(k) for k in kc])
    bounds = np.array([(p.low, p.high) for p in find("added_mass_amplitude").parameters]).T

    def differences(x: Any) -> Any:
        return 1.0 - x[0] * kc**2 / (kc**2 + x[1] ** 2) - published

    found = optimize.least_squares(differences, (-0.5, 5.0), bounds=tuple(bounds))
    return float(found.x[0]), float(found.x[1])


def swing(
    kc: float, keys: Mapping[str, Any], effect: str = "", parameters: tuple[float, ...] = ()
) -> tuple[float, float]:
    """Swing a plate sinusoidally across the water, and return (C_D, C_M) by Morison's regression.

    The water's force over the last periods is fitted by -1/2 rho C_D h L |v| v - C_M rho pi h^2 / 4 L v'.

    Args:
        kc: 2 pi A / h.
        keys: coefficients of the `mjfish.StripLink`.
        effect: a cause of the catalogue whose force acts too.
        parameters: of the effect.
    """
    load = find(effect).load if effect else None
    memory = load.memory if load else 0
    states = "".join(
        f'<general name="strip_fluid/memory/{k}" joint="sway" dyntype="integrator" gainprm="0"/>'
        for k in range(1, memory + 1)
    )
    step = _PERIOD / _STEPS
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option gravity="0 0 0" integrator="RK4" timestep="{step}"/>
          <worldbody><body name="plate">
            <joint name="sway" type="slide" axis="0 1 0"/>
            <inertial pos="0 0 0" mass="{_CARRIAGE}" diaginertia="1 1 1"/>
          </body></worldbody>
          <actuator>{states}</actuator>
        </mujoco>""")
    link = {"body": "plate", "length": _LENGTH, "height": _HEIGHT, "width": 0.001, **keys}
    fluid = StripFluid(model, [link], density=_DENSITY, loads=[(load, parameters)] if load else [])
    data = mujoco.MjData(model)
    omega = 2.0 * np.pi / _PERIOD
    top = kc * _HEIGHT / _PERIOD
    log = []
    with fluid.installed():
        for k in range((_SETTLE + _FIT) * _STEPS):
            data.qvel[0] = top * np.sin(omega * k * step)
            data.qfrc_applied[0] = _CARRIAGE * top * omega * np.cos(omega * k * step)
            if k >= _SETTLE * _STEPS:
                mujoco.mj_forward(model, data)
                log.append((data.qvel[0], data.qacc[0], fluid.wrenches(data)["total"][0, 1]))
            mujoco.mj_step(model, data)
    v, a, force = np.array(log).T
    drag = -0.5 * _DENSITY * _HEIGHT * _LENGTH * np.abs(v) * v
    inertia = -_DENSITY * np.pi / 4.0 * _HEIGHT**2 * _LENGTH * a
    (c_d, c_m), *_ = np.linalg.lstsq(np.column_stack([drag, inertia]), force)
    return float(c_d), float(c_m)
