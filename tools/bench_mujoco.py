"""Comparisons of `tools/bench.py` about the force of the water in MuJoCo, all on the planar pike."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import mujoco
import mujoco.rollout
import numpy as np

from comparison import Comparison, Side
from mjfish.drive import cpg, modes
from mjfish.fish import load_fish
from mjfish.mujoco import StripFluid, mjcf
from proofs import reference

_PIKE = load_fish("pike")
_COMMAND = cpg.joint_motion(_PIKE.cpg, modes.drive("v1"), 10.0, 0.01).angle[:, 0]


def _pike(integrator: mjcf.Integrator, *, commanded: bool = False) -> StripFluid:
    """The pike as a foreign user has it: a model, and water on its bodies; step 1 ms."""
    model = mjcf.prepared(_PIKE, mjcf.spec(_PIKE), 0.001, integrator).compile()
    return StripFluid(model, mjcf.strips(_PIKE), density=_PIKE.density, commanded=commanded)


def _swim(fluid: StripFluid, data: mujoco.MjData, samples: int) -> None:
    """Swim for `samples` hundredths of a second."""
    mujoco.mj_resetData(fluid.model, data)
    for angles in _COMMAND[:samples]:
        data.ctrl[:] = angles
        mujoco.mj_step(fluid.model, data, 10)
    if fluid.state(data).status != "ok":
        raise SystemExit(f"the fish diverged: {fluid.state(data).message}")


def _force(integrator: mjcf.Integrator, target: float) -> Comparison:
    fluid = _pike(integrator)
    data = mujoco.MjData(fluid.model)

    def wet() -> None:
        with fluid.installed():
            _swim(fluid, data, len(_COMMAND))

    return Comparison(
        top=Side("with the force of the water", wet, times=2),
        bottom=Side("the same model without", lambda: _swim(fluid, data, len(_COMMAND)), times=2),
        target=target,
        at_least=False,
    )


def mujoco_force_euler() -> Comparison:
    """10 s of the swimming fish, Euler, step 1 ms: with the compiled force, against none."""
    return _force("Euler", 2.5)


def mujoco_force_implicitfast() -> Comparison:
    """The same with implicitfast."""
    return _force("implicitfast", 2.5)


def mujoco_force_rk4() -> Comparison:
    """The same with RK4, which asks for the force four times a step."""
    return _force("RK4", 2.6)


def mujoco_block_a_step() -> Comparison:
    """1 s of the swimming fish, Euler, its cheapest step: a block around each step, against one around them all.

    Entering, leaving, and the first step on the data, which is noted, are all in it.
    """
    fluid = _pike("Euler")
    data = mujoco.MjData(fluid.model)

    def swim(block: Callable[[], AbstractContextManager[None]]) -> np.ndarray:
        mujoco.mj_resetData(fluid.model, data)
        for angles in _COMMAND[:100]:
            data.ctrl[:] = angles
            for _ in range(10):
                with block():
                    mujoco.mj_step(fluid.model, data)
        return data.qpos.copy()

    def inside() -> np.ndarray:
        with fluid.installed():
            return swim(nullcontext)

    if not np.array_equal(swim(fluid.installed), inside()):
        raise SystemExit("mujoco_block_a_step: they do not swim alike")
    return Comparison(
        top=Side("a block around each step", lambda: swim(fluid.installed)),
        bottom=Side("one block around all", inside),
        target=5.0,
        at_least=False,
    )


def compiled_vs_numpy_callback() -> Comparison:
    """0.2 s of the swimming fish, Euler: the force in plain NumPy as a Python callback, against the compiled one.

    What the step costs without any force is in both.
    """
    fluid = _pike("Euler")
    data = mujoco.MjData(fluid.model)

    def compiled() -> None:
        with fluid.installed():
            _swim(fluid, data, 20)

    def plain() -> None:
        mujoco.set_mjcb_control(reference.control)
        try:
            _swim(fluid, data, 20)
        finally:
            mujoco.set_mjcb_control(None)

    compiled()
    expected = data.qvel.copy()
    plain()
    if not np.allclose(data.qvel, expected, rtol=1e-6, atol=1e-8):
        raise SystemExit(f"compiled_vs_numpy_callback: they do not swim alike: {data.qvel} and {expected}")
    return Comparison(
        top=Side("plain NumPy, a Python callback", plain),
        bottom=Side("compiled", compiled, times=20),
        target=50.0,
        at_least=True,
    )


def two_threads() -> Comparison:
    """16 runs of 2 s by mujoco.rollout, RK4: one thread against two, wall time; the same trajectories, bit for bit."""
    fluid = _pike("RK4")
    model = fluid.model
    start = np.zeros((16, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    control = np.repeat(_COMMAND[None, :200], 10, axis=1) * np.linspace(0.2, 1.0, 16)[:, None, None]

    def roll(threads: int) -> np.ndarray:
        with fluid.installed(), mujoco.rollout.Rollout(nthread=threads) as pool:
            states, _ = pool.rollout(model, [mujoco.MjData(model) for _ in range(threads)], start, control)
        return states

    if not np.array_equal(roll(1), roll(2)):
        raise SystemExit("two_threads: the trajectories differ")
    return Comparison(
        top=Side("one thread", lambda: roll(1)),
        bottom=Side("two threads", lambda: roll(2)),
        target=1.6,
        at_least=True,
        clock=time.perf_counter,
    )


COMPARISONS: tuple[Callable[[], Comparison], ...] = (
    mujoco_force_euler,
    mujoco_force_implicitfast,
    mujoco_force_rk4,
    mujoco_block_a_step,
    compiled_vs_numpy_callback,
    two_threads,
)

_FIRST_USE = """
import time
start = time.perf_counter()
from mjfish import StripFluid
imported = time.perf_counter() - start
import mujoco
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body name="plate"><joint type="slide" axis="0 1 0"/><geom size=".1"/></body>'
    '</worldbody></mujoco>'
)
fluid = StripFluid(model, [{"body": "plate", "length": 0.3, "height": 0.2, "width": 0.01}])
with fluid.installed():
    mujoco.mj_step(model, mujoco.MjData(model))
print(imported, time.perf_counter() - start)
"""


def first_use() -> dict[str, tuple[float, float]]:
    """Return wall seconds and their bounds: first use with nothing compiled, and import once that is done."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "XDG_CACHE_HOME": cache}
        times = []
        for _ in range(2):
            ran = subprocess.run(
                [sys.executable, "-c", _FIRST_USE], env=environment, check=True, capture_output=True, text=True
            )
            times.append([float(number) for number in ran.stdout.split()])
    return {"first_use": (times[0][1], 30.0), "import": (times[1][0], 1.5), "second_use": (times[1][1], 3.0)}
