"""Bodies lighter than the water rise, heavier ones sink, as Archimedes and the added mass say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mjfish.mujoco import StripFluid
from mjfish.mujoco.coupling_choice import Coupling

#: Of a round bar: length and radius [m].
_LENGTH, _RADIUS = 0.4, 0.03
_RHO, _GRAVITY, _C_D = 1000.0, 9.81, 1.2


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("density", [300.0, 1000.0, 2700.0])
def test_a_bar_rises_hovers_or_sinks_as_on_paper(density: float, coupling: Coupling) -> None:
    """The speed is V tanh(t / T) with F = (rho - density) V g, V = sqrt(2 F / (rho c_d 2 r L)), T = (m + m_a) V / F."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 -{_GRAVITY}" integrator="RK4" timestep=".002"/><worldbody>
        <body name="bar"><freejoint/><geom type="cylinder" size="{_RADIUS} {_LENGTH / 2}" zaxis="1 0 0"
        pos="{-_LENGTH / 2} 0 0" density="{density}"/></body></worldbody></mujoco>"""
    )
    bar = {"body": "bar", "length": _LENGTH, "height": 2 * _RADIUS, "width": 2 * _RADIUS, "c_d": _C_D}
    fluid = StripFluid(model, [bar], density=_RHO, coupling=coupling)
    data = mujoco.MjData(model)
    volume = np.pi * _RADIUS**2 * _LENGTH
    force = (_RHO - density) * volume * _GRAVITY
    with fluid.installed():
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[2], force / ((density + _RHO) * volume), rtol=1e-9, atol=1e-9)
        mujoco.mj_step(model, data, nstep=500)
    terminal = np.sqrt(2.0 * abs(force) / (_RHO * _C_D * 2.0 * _RADIUS * _LENGTH))
    rate = abs(force) / ((density + _RHO) * volume)
    expected = np.sign(force) * terminal * np.tanh(rate * data.time / terminal) if force else 0.0
    assert data.qvel[2] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(data.qvel[[0, 1, 3, 4, 5]], 0.0, atol=1e-9)
    assert np.sign(round(data.qpos[2], 6)) == np.sign(force)
