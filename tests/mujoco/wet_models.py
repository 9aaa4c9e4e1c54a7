"""Models that the tests put into water: a tree with a free root, hinges, servos and a dry body; a plate that slides."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from mjfish.hydro.load import load
from mjfish.mujoco import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.numerics.arrays import FloatArray

#: Of MuJoCo's RK4 where a body turns in space; `test_supported` shows it without any water.
RK4_ORDER = 4.0 if int(mujoco.__version__.split(".")[0]) >= 4 else 2.0


def skip_without_fourth_order() -> None:
    """Skip a test of errors that are as small as those of MuJoCo 4."""
    if RK4_ORDER < 4.0:
        pytest.skip("MuJoCo 3 turns bodies in space with second order")


#: A free trunk with a tail on a hinge and a dry weight on a spring; servos on hinge and slide.
TREE = """
<mujoco model="tree">
  <option integrator="RK4" timestep="0.002" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="trunk"><freejoint/>
      <geom type="ellipsoid" size=".2 .04 .06" pos="-.2 0 -.002" density="800"/>
      <body name="tail" pos="-.4 0 0"><joint name="tail" axis="0 0 1"/>
        <geom type="ellipsoid" size=".1 .01 .06" pos="-.1 0 0" density="900"/></body>
      <body name="weight" pos="-.1 0 0"><joint name="weight" type="slide" axis="1 0 0" stiffness="40" damping=".1"/>
        <geom size=".02" density="3000"/></body>
    </body>
  </worldbody>
  <actuator><position joint="tail" kp="4" kv=".02"/><position joint="weight" kp="20" kv=".1"/></actuator>
</mujoco>
"""
#: A plate that slides along y; nothing else.
PLATE = """
<mujoco model="plate">
  <option gravity="0 0 0"/>
  <worldbody><body name="plate"><joint type="slide" axis="0 1 0"/>
    <geom type="box" size=".15 .002 .1" pos="-.15 0 0" density="2000"/></body></worldbody>
</mujoco>
"""
PLATE_LINK = {"body": "plate", "length": 0.3, "height": 0.2, "width": 0.004}


def tree_links(**coefficients: float) -> list[dict[str, Any]]:
    """Return the links of TREE; `coefficients` replace those of both."""
    return [
        {
            "body": "trunk",
            "length": 0.4,
            "station": [0.0, 0.1, 0.4],
            "height": [0.0, 0.12, 0.06],
            "width": [0.0, 0.08, 0.03],
            "c_d": 0.6,
            "munk_moment": 1.0,
            **coefficients,
        },
        {"body": "tail", "length": 0.2, "height": [0.05, 0.12], "width": 0.004, "c_d": 1.8, **coefficients},
    ]


def compiled(xml: str, *, integrator: str | None = None, **options: str) -> mujoco.MjModel:
    """Compile MJCF; `integrator` and other attributes replace those of its option."""
    spec = mujoco.MjSpec.from_string(xml)
    if integrator is not None:
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    for name, value in options.items():
        setattr(spec.option, name, value)
    return compile_aside(spec)


def with_custom(entries: dict[str, Any]) -> mujoco.MjModel:
    """Return the tree with custom numerics."""
    spec = mujoco.MjSpec.from_string(TREE)
    for name, value in entries.items():
        spec.add_numeric(name=name, data=np.atleast_1d(np.asarray(value, dtype=float)))
    return spec.compile()


@load
def pushing(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Push as a load may: by everything that it can read of a link."""
    push = parameters[0] * link.strip_height[5] * link.c_d
    turn = parameters[1] * (link.mass * link.com + link.inertia) * (1.0 + link.last)
    return -push * link.u * link.length, -push * link.v, -turn * link.w - push * link.u * link.v


#: Two loads, the second without its second parameter.
PUSHES = ((pushing, (3.0, 0.5)), (pushing, (1.0,)))


def tree(
    coupling: str | None = None, *, integrator: str | None = None, loaded: bool = False, **coefficients: float
) -> StripFluid:
    """Return the tree in water; where it is loaded, with PUSHES on its links."""
    return StripFluid(
        compiled(TREE, integrator=integrator),
        tree_links(**coefficients),
        coupling=coupling,  # type: ignore[arg-type]
        loads=PUSHES if loaded else (),
    )


def stirred(model: mujoco.MjModel, seed: int = 3) -> mujoco.MjData:
    """Return data in a state that moves in every dof, commands set."""
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, 0.3 * random.normal(size=model.nv), 1.0)
    data.qvel[:] = 0.5 * random.normal(size=model.nv)
    data.ctrl[:] = 0.3 * random.normal(size=model.nu)
    return data


def full_state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return the state that a step goes on from, without what warms the solver."""
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    return state
