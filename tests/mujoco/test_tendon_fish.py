"""The tendon-driven fish in MuJoCo: hand-written, and swimming as the ODE does on joint angles that were measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import prescribed
from mjfish import ode
from mjfish.data import importers
from mjfish.drive import measured, wave
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish, load_fish
from mjfish.mujoco import mjcf, simulate
from mjfish.numerics.arrays import FloatArray

#: What only the geoms, there for looks, decide.
_LOOKS = {"body_geomadr", "body_geomnum", "dof_length"}
_LAW = wave.Wave(0.75, (0.24, 0.21, 0.16, 0.10, 0.18), (0.0, -0.4, -0.8, -1.2, -1.6), (0.03,) * 5)


@pytest.fixture(scope="module")
def tendon() -> Fish:
    return load_fish("eth_tendon")


def _filmed() -> tuple[FloatArray, FloatArray]:
    """Return times (n,) and joint angles (n, 5) as a camera has them: 30 a second, off by 0.01 rad."""
    time = np.arange(0.0, 2.0, 1.0 / 30.0)
    angle = wave.joint_motion(_LAW, 0.0, 2.0, 0.005).angle_at(time)
    return time, angle + np.random.default_rng(3).normal(0.0, 0.01, angle.shape)


def _apart(fish: Fish, motion: JointMotion) -> float:
    """Return the largest difference of both engines, relative to the range of the channel."""
    run = prescribed.simulate(fish, motion)
    assert run.status == "ok"
    swum = ode.simulate(fish, motion, values=fish.values).at(run.time)[:, :3]
    return float((np.abs(run.velocity - swum).max(axis=0) / np.ptp(swum, axis=0)).max())


def test_hand_written_and_built_fish_are_the_same_model(tendon: Fish) -> None:
    """Catches a number of the XML that was not changed with the fish's TOML."""
    written, built = mjcf.spec(tendon).compile(), mjcf.build(tendon).compile()
    assert written.geom("box").id >= 0, "spec() did not take the hand-written file"
    for name in dir(built):
        if name.partition("_")[0] in ("body", "jnt", "dof", "actuator") and "_" in name and name not in _LOOKS:
            np.testing.assert_allclose(getattr(written, name), getattr(built, name), rtol=1e-12, atol=0, err_msg=name)


def test_engines_agree_on_filmed_joint_angles_and_converge(tendon: Fish) -> None:
    """The joints do exactly what was measured. The order is four: a quarter of the step leaves far below a tenth."""
    time, angle = _filmed()
    coarse, fine = (_apart(tendon, measured.joint_motion(time, angle, step)) for step in (0.004, 0.001))
    assert fine < 1e-5, fine
    assert fine < 0.1 * coarse, (fine, coarse)


def test_ode_swims_as_the_servos_of_mujoco_realised_filmed_joint_angles(tendon: Fish) -> None:
    """The servos give way to the water by up to 0.15 rad; on what they did, bodies and water must be the same."""
    run = simulate(tendon, measured.joint_motion(*_filmed(), 0.001))
    assert run.status == "ok", run.message
    assert np.abs(run.joint_angle - run.command.angle_at(run.time)).max() < 0.15
    swum = ode.simulate(tendon, run.motion(), values=tendon.values).at(run.time)[:, :3]
    assert (np.abs(run.velocity - swum).max(axis=0) / np.ptp(swum, axis=0)).max() < 1e-3


@pytest.mark.real
def test_engines_agree_on_the_joint_angles_of_the_real_fish(tendon: Fish, fishsim: Path) -> None:
    dataset, _ = importers.import_files("fishsim", [fishsim / "markers_f1_00.csv"])
    (trial,) = dataset.trials
    assert trial.joint_angle is not None
    assert _apart(tendon, measured.joint_motion(trial.time, trial.joint_angle, 0.001)) < 1e-5
