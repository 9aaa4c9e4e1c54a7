"""Joints that turn by another share of what they are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recovery import found_again, with_measured_joints

from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.effects import find
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

GAIN = find("joint_gain_error")
ERRORS = {"joint_1": 0.1, "joint_2": 0.0, "joint_3": -1.0, "joint_4": -0.2}


def test_each_joint_is_scaled_by_its_own_gain_with_rates_and_accelerations(pike: Fish, turning: Trial) -> None:
    """A gain of -1 is a dead joint."""
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    reached = GAIN.drive(command, ERRORS)
    for part in ("angle", "rate", "acceleration"):
        told, found = getattr(command, part), getattr(reached, part)
        np.testing.assert_allclose(found, told * [1.1, 1.0, 0.0, 0.8], rtol=0.0, atol=1e-12)


def test_it_has_a_gain_for_every_joint() -> None:
    own = GAIN.for_fish(load_fish("one_joint"))
    assert [p.name for p in own.parameters] == ["joint_gain_error.joint_1"]


def test_a_sensor_of_a_joint_has_a_gain_too(pike: Fish, turning: Trial) -> None:
    """Measured angles are scaled as commands are. Catches measured joints that are left alone."""
    trial = with_measured_joints(pike, turning)
    assert trial.joint_angle is not None
    scaled = replace(trial, joint_angle=readonly(trial.joint_angle * [1.1, 1.0, 0.0, 0.8]))
    model = Model(pike, (GAIN,))
    np.testing.assert_allclose(
        model.predict(trial, model.values({f"joint_gain_error.{joint}": g for joint, g in ERRORS.items()})).velocity,
        model.predict(scaled, model.values({})).velocity,
        atol=1e-9,
    )


@pytest.mark.parametrize("sizes", [{"joint_3": -0.3}, {"joint_1": 0.05, "joint_4": -0.1}])
def test_hidden_gains_are_found_again(pike: Fish, sizes: dict[str, float]) -> None:
    found_again(pike, GAIN, sizes)
