"""Soft saturation of the joint angles."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, found_again

from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.effects import find
from mjfish.fish import Fish

SATURATION = find("servo_saturation")


def test_small_angles_lose_half_psi_times_their_cube_and_none_passes_the_largest(pike: Fish, turning: Trial) -> None:
    """Catches a saturation of the wrong order or size, and one that turns round."""
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    small = 0.05
    lost = command.angle - SATURATION.drive(command, {"psi": small, "softness": 0.5}).angle
    np.testing.assert_allclose(lost, 0.5 * small * command.angle**3, rtol=0.06, atol=1e-12)
    strong = SATURATION.drive(command, {"psi": 10.0, "softness": 0.5}).angle
    assert np.max(np.abs(strong)) < 10.0**-0.5 < np.max(np.abs(command.angle))
    order = np.argsort(command.angle.ravel())
    assert np.all(np.diff(strong.ravel()[order]) >= 0.0)


def test_the_sharper_it_is_the_nearer_to_a_hard_stop(pike: Fish, turning: Trial) -> None:
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005).angle
    motion = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    limit = 0.6 * np.max(np.abs(command))
    stopped = np.clip(command, -limit, limit)
    off = [
        np.max(np.abs(SATURATION.drive(motion, {"psi": limit**-2.0, "softness": 1.0 / p}).angle - stopped))
        for p in (2.0, 6.0, 20.0)
    ]
    assert off[0] > 2.0 * off[1] > 4.0 * off[2]
    assert off[2] < 0.04 * limit


@pytest.mark.parametrize(("psi", "softness"), [(0.02, 0.5), (0.5, 0.5), (0.5, 0.14), (2.0, 0.14)])
@pytest.mark.parametrize("short", ["psi", "softness"])
def test_its_sensitivity_is_that_of_predictions(
    pike: Fish, turning: Trial, psi: float, softness: float, short: str
) -> None:
    assert derivative_error(pike, turning, SATURATION, {"psi": psi, "softness": softness}, short) < 1e-7


def test_it_has_a_derivative_at_the_null(pike: Fish, turning: Trial) -> None:
    """It is smooth there: the slope from psi = 0 on is that of the differences to both sides."""
    assert SATURATION.smooth
    assert derivative_error(pike, turning, SATURATION, {"psi": 0.0}, "psi") < 1e-6


def test_a_hidden_saturation_is_found_again(pike: Fish) -> None:
    sizes = {"psi": 0.15}
    found = found_again(pike, SATURATION, sizes)
    assert found.sigma["servo_saturation.psi"] < 0.02
