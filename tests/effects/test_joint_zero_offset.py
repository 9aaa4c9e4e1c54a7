"""Joints whose zero is off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recovery import derivative_error, found_again, with_measured_joints

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg
from mjfish.drive.motion import JointMotion
from mjfish.effects import find
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

ZERO = find("joint_zero_offset")
BEND = {"joint_1": 0.02, "joint_2": -0.015, "joint_3": 0.02, "joint_4": 0.03}


def test_each_joint_is_bent_by_its_own_offset_and_moves_as_commanded(pike: Fish, turning: Trial) -> None:
    """Catches offsets in another order than the joints."""
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    bent = ZERO.drive(command, BEND)
    expected = np.broadcast_to(list(BEND.values()), command.angle.shape)
    np.testing.assert_allclose(bent.angle - command.angle, expected, rtol=0.0, atol=1e-15)
    assert np.array_equal(bent.rate, command.rate)
    assert np.array_equal(bent.acceleration, command.acceleration)


def test_a_fish_bent_to_one_side_turns_and_bent_to_the_other_turns_the_other_way(pike: Fish, straight: Trial) -> None:
    model = Model(pike, (ZERO,))
    turned = [
        model.predict(straight, model.values({f"joint_zero_offset.joint_{i}": bend for i in range(1, 5)}))
        .rollout.at(straight.time)[-1, 5]
        for bend in (0.03, 0.0, -0.03)
    ]  # fmt: skip
    assert abs(turned[0] - turned[2]) > 0.3
    assert turned[0] + turned[2] == pytest.approx(2.0 * turned[1], abs=0.2 * abs(turned[0] - turned[2]))


@pytest.mark.parametrize("joints", [1, 2, 5, 9])
def test_it_has_an_offset_for_every_joint(joints: int, straight: Trial) -> None:
    """Catches a declaration for four joints alone."""
    fish = SimpleNamespace(joints=joints)
    own = ZERO.for_fish(fish)  # type: ignore[arg-type]
    assert own is ZERO.for_fish(fish)  # type: ignore[arg-type]
    assert own is not None
    assert [p.short for p in own.parameters] == [f"joint_{k}" for k in range(1, joints + 1)]
    own.check_declaration()
    still = np.zeros((3, 3, joints))
    motion = JointMotion(np.linspace(0.0, 1.0, 4), still, still, still)
    bend = {f"joint_{k}": 0.01 * k for k in range(1, joints + 1)}
    np.testing.assert_allclose(own.drive(motion, bend).angle[0, 0], list(bend.values()))


def test_a_fish_of_five_joints_has_it(straight: Trial) -> None:
    """By its full names, in the model, too. Catches a fish that is refused for its number of joints."""
    tendon = load_fish("eth_tendon")
    assert tendon.joints == 5
    assert ZERO.not_applicable(Dataset("d", tendon, (straight,))) == ""
    names = [p.name for p in Model(tendon, (ZERO,)).parameters]
    assert names[-1] == "joint_zero_offset.joint_5"


@pytest.mark.parametrize("short", BEND)
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_its_sensitivities_are_those_of_predictions(pike: Fish, turning: Trial, short: str, share: float) -> None:
    values = {name: share * bend for name, bend in BEND.items()}
    assert derivative_error(pike, turning, ZERO, values, short) < 1e-7


def test_hidden_offsets_are_found_again(pike: Fish) -> None:
    found = found_again(pike, ZERO, BEND)
    assert max(found.sigma[f"joint_zero_offset.{short}"] for short in BEND) < 0.01


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_sensor_of_a_joint_has_a_zero_too(pike: Fish, turning: Trial, share: float) -> None:
    """Measured angles are moved as commands are, with derivatives. Catches measured joints that are left alone."""
    trial = with_measured_joints(pike, turning)
    assert ZERO.not_applicable(Dataset("d", pike, (trial,))) == ""
    assert derivative_error(pike, trial, ZERO, {n: share * bend for n, bend in BEND.items()}, "joint_2") < 1e-7
    tracked = replace(trial, errors=readonly(np.zeros((1, len(trial.time), 3 + len(BEND)))))
    assert "joint angles were measured" in ZERO.not_applicable(Dataset("d", pike, (tracked,)))
    model = Model(pike, (ZERO,))
    values = {f"joint_zero_offset.{short}": bend for short, bend in BEND.items()}
    moved = replace(trial, joint_angle=readonly(trial.joint_angle + list(BEND.values())))  # type: ignore[operator]
    np.testing.assert_allclose(
        model.predict(trial, model.values(values)).velocity,
        model.predict(moved, model.values({})).velocity,
        atol=1e-9,
    )
