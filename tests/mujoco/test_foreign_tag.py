"""The tag of one model on another: its numbers speak of bodies that are not there."""

from __future__ import annotations

import mujoco
import numpy as np

from mjfish.mujoco import StripFluid

_ONE = '<mujoco><worldbody><body name="a"><freejoint/><geom size=".1" pos=".01 0 0"/></body>{more}</worldbody></mujoco>'


def test_a_tag_copied_to_a_model_of_another_shape_spoils_the_step() -> None:
    """It would read beyond the end of what is there; or push the wrong bodies."""
    fluid = StripFluid(
        mujoco.MjModel.from_xml_string(_ONE.format(more="")),
        [{"body": "a", "length": 0.2, "height": 0.1, "width": 0.1}],
    )
    other = mujoco.MjModel.from_xml_string(_ONE.format(more='<body name="b"><joint/><geom size=".1"/></body>'))
    other.opt.o_solimp[:] = fluid.model.opt.o_solimp
    other.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = mujoco.MjData(other)
    with fluid.installed():
        mujoco.mj_forward(other, data)
    assert np.isnan(data.qacc).all()
    assert fluid.state(data).message.endswith(
        ": opt.o_solimp is that of another model; call StripFluid(model, links) on this one"
    )
