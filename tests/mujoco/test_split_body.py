"""A body that is two bodies of the model, welded by having no joint, is in the water what the whole is."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from mjfish.mujoco import StripFluid
from mjfish.mujoco.coupling_choice import Coupling

_HALF = '<geom type="box" size=".075 .01 .05" pos="-.075 0 0" density="900"/>'
_HALVES = (
    '<mujoco><option gravity="0 0 -9.81" integrator="RK4" timestep=".002"/><default><geom contype="0" conaffinity="0"/>'
    f'</default><worldbody><body name="front"><freejoint/>{_HALF}<body name="back" pos="-.15 0 0">{_HALF}</body>'
    "</body></worldbody></mujoco>"
)
_WHOLE = (
    _HALVES.replace('<body name="back" pos="-.15 0 0">', "")
    .replace("</body></body>", "</body>")
    .replace(f"{_HALF}{_HALF}", '<geom type="box" size=".15 .01 .05" pos="-.15 0 0" density="900"/>')
)
_SECTION = {"height": 0.1, "width": 0.02, "c_d": 1.5, "munk_moment": 1.0}


def _water(xml: str, bodies: tuple[str, ...], coupling: Coupling) -> tuple[StripFluid, mujoco.MjData]:
    links: list[dict[str, Any]] = [{**_SECTION, "body": body, "length": 0.3 / len(bodies)} for body in bodies]
    fluid = StripFluid(mujoco.MjModel.from_xml_string(xml), links, coupling=coupling, current=(0.1, -0.2, 0.05))
    data = mujoco.MjData(fluid.model)
    data.qvel[:] = 0.8, 1.0, 0.7, 0.3, 0.5, -0.4
    return fluid, data


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_two_halves_have_the_force_of_the_whole_and_move_alike(coupling: Coupling) -> None:
    """Force and moment about one point, in water that flows; catches moments of a child about the wrong point."""
    ends, totals = [], []
    for xml, bodies in ((_WHOLE, ("front",)), (_HALVES, ("front", "back"))):
        fluid, data = _water(xml, bodies, coupling)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
            total = fluid.wrenches(data)["total"]
            arms = data.xipos[[fluid.model.body(body).id for body in bodies]] - data.xpos[1]
            moments = total[:, 3:] + np.cross(arms, total[:, :3])
            totals.append([*total[:, :3].sum(axis=0), *moments.sum(axis=0), *data.qacc])
            mujoco.mj_step(fluid.model, data, nstep=50)
            ends.append([*data.qpos, *data.qvel])
    np.testing.assert_allclose(totals[1], totals[0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-5, atol=1e-6)
    assert np.abs(totals[0]).min() > 1e-3, "every part of the force must act"
