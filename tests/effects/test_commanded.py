"""What every cause between command and joints must keep: a motion whose parts belong to each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg
from mjfish.drive.motion import JointMotion
from mjfish.effects import Effect, find
from mjfish.effects.commanded import balanced
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

#: Sizes that act on the trial's drive.
SIZES = {
    "joint_zero_offset": {"joint_1": 0.02, "joint_2": -0.03, "joint_3": 0.01, "joint_4": 0.05},
    "servo_backlash": {**{f"joint_{i}": 0.03 for i in range(1, 5)}, "contact": 0.003},
    "servo_delay": {"time": 0.0213},
    "servo_dynamics": {"time": 0.02, "delay": 0.0117, "slowness": 0.1, "damping": 0.5, "catch_up": 150.0},
    "servo_lag": {"time_constant": 0.03},
    "servo_limited_lag": {"slowness": 0.1, "time": 0.01},
    "servo_rate_limit": {"slowness": 0.1},
    "servo_saturation": {"psi": 0.5, "softness": 0.17},
    "servo_second_order": {"time": 0.02, "damping": 0.5},
}
over_all = pytest.mark.parametrize("effect", [find(name) for name in SIZES], ids=SIZES)


def _driven(fish: Fish, trial: Trial, effect: Effect, step: float) -> tuple[JointMotion, JointMotion]:
    """Return the command and what the joints make of it."""
    command = cpg.joint_motion(fish.cpg, trial.drive, 3.0, step)
    return command, effect.drive(command, SIZES[effect.name])


@over_all
def test_rate_and_acceleration_are_slopes_at_the_ends_of_every_step(pike: Fish, turning: Trial, effect: Effect) -> None:
    """Difference quotients on a grid ten times as fine as the quickest motion, but across steps of the drive."""
    sharp = effect.name in ("servo_rate_limit", "servo_limited_lag")  # corners that nothing rounds
    _, motion = _driven(pike, turning, effect, 1e-5 if sharp else 2e-4)
    settled = (motion.time[:-1] > 0.05) & (np.abs(motion.time[:-1] - 1.5) > 0.05)
    steps = np.diff(motion.time)[:, None]
    for low, high in ((motion.angle, motion.rate), (motion.rate, motion.acceleration)):
        quotient = (low[:, 2] - low[:, 0]) / steps
        mean = 0.5 * (high[:, 0] + high[:, 2])
        assert np.max(np.abs(quotient - mean)[settled]) < 0.02 * np.max(np.abs(high))


@over_all
def test_over_a_step_the_acceleration_adds_up_to_the_rate_and_the_rate_to_the_angle(
    pike: Fish, turning: Trial, effect: Effect
) -> None:
    """By Simpson's rule, on the grid of the model. Catches an impulse that the head would get and no joint made."""
    _, motion = _driven(pike, turning, effect, 0.005)
    steps = np.diff(motion.time)[:, None]
    for low, high, scale in ((motion.angle, motion.rate, 1.0), (motion.rate, motion.acceleration, 300.0)):
        summed = (high[:, 0] + 4.0 * high[:, 1] + high[:, 2]) * steps / 6.0
        np.testing.assert_allclose(low[:, 2] - low[:, 0], summed, rtol=0.0, atol=1e-5 * scale)


@over_all
def test_between_steps_angles_do_not_jump_and_rates_only_where_the_commands_do(
    pike: Fish, turning: Trial, effect: Effect
) -> None:
    command, motion = _driven(pike, turning, effect, 0.005)
    assert np.max(np.abs(motion.angle[1:, 0] - motion.angle[:-1, 2])) < 1e-12
    jumps, asked = (np.max(np.abs(m.rate[1:, 0] - m.rate[:-1, 2]), axis=1) for m in (motion, command))
    assert np.max(jumps[asked < 1e-6]) < 1e-6
    assert np.count_nonzero(asked > 0.1) == 1


@over_all
def test_the_model_integrates_it_as_well_as_a_finer_step_does(pike: Fish, turning: Trial, effect: Effect) -> None:
    """Within a tenth of the noise of a camera. Catches a corner that falls between the nodes and is lost."""
    model = Model(pike, (effect,))
    values = model.values({f"{effect.name}.{short}": size for short, size in SIZES[effect.name].items()})
    coarse, fine = (replace(model, step=h).predict(turning, values).velocity for h in (0.005, 0.0005))
    counted = np.abs(turning.time - 1.5) > 0.03
    assert np.all(np.sqrt(np.mean((coarse - fine)[counted] ** 2, axis=0)) < [4e-4, 4e-4, 2.5e-3])


@over_all
def test_measured_joint_angles_are_what_the_joints_got_but_for_the_zeros_of_their_sensors(
    pike: Fish, straight: Trial, effect: Effect
) -> None:
    time = np.linspace(0.0, 1.0, 51)
    angle = 0.3 * np.sin(18.0 * time[:, None] - np.arange(4))
    measured = Trial("m", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(angle))
    model = Model(pike, (effect,))
    sizes = {f"{effect.name}.{short}": size for short, size in SIZES[effect.name].items()}
    got = [model.predict(measured, model.values(given)).velocity for given in ({}, sizes)]
    if effect.of_sensors:
        assert np.abs(got[0] - got[1]).max() > 1e-4
        assert effect.not_applicable(Dataset("m", pike, (measured,))) == ""
        return
    assert got[0].tobytes() == got[1].tobytes()
    assert "joint angles were measured" in effect.not_applicable(Dataset("m", pike, (measured,)))
    assert effect.not_applicable(Dataset("both", pike, (measured, straight))) == ""


def test_balancing_leaves_a_motion_alone_that_is_balanced_and_mends_one_that_is_not() -> None:
    """A cubic angle is one; a mid-step acceleration of nonsense is replaced by the one that the rates ask for."""
    time = np.array([0.0, 0.1, 0.3])
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]
    parts = (stages**3, 3.0 * stages**2, 6.0 * stages)
    nonsense = parts[2].copy()
    nonsense[:, 1] = 99.0
    for acceleration in (parts[2], nonsense):
        motion = balanced(time, parts[0], parts[1], acceleration)
        for found, expected in zip((motion.angle, motion.rate, motion.acceleration), parts, strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
