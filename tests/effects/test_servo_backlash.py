"""Play of the gears, against the play operator and its closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, deviations, found_again, refitted, synthetic
from scipy.integrate import solve_ivp

from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.drive.motion import JointMotion, grid
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray

BACKLASH = find("servo_backlash")
CONTACT = 0.003
#: Width of the gap of every joint [rad].
PLAYS = {f"joint_{i}": 0.04 for i in range(1, 5)}


def _sinusoid(omega: float, duration: float, step: float = 0.005) -> JointMotion:
    time = grid(np.array([0.0, duration]), step)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]
    return JointMotion(
        time, np.sin(omega * stages), omega * np.cos(omega * stages), -(omega**2) * np.sin(omega * stages)
    )


def _play(command: FloatArray, width: float) -> FloatArray:
    """Return the play operator of a dense command."""
    held = np.empty_like(command)
    held[0] = command[0]
    for i in range(1, len(command)):
        held[i] = max(command[i] - 0.5 * width, min(command[i] + 0.5 * width, held[i - 1]))
    return held


def test_what_the_play_takes_off_comes_out_through_the_lag_of_the_contact() -> None:
    """Solves T^2 x'' + 2 T x' + x = d anew, by scipy, from the play operator on a dense command."""
    omega, width = 18.0, 0.1
    motion = BACKLASH.drive(_sinusoid(omega, 1.0), {"joint_1": width, "contact": CONTACT})
    dense = np.linspace(0.0, 1.0, 200_001)
    off = _play(np.sin(omega * dense), width) - np.sin(omega * dense)

    def rates(t: float, x: FloatArray) -> list[float]:
        d = float(np.interp(t, dense, off))
        return [x[1], (d - x[0] - 2.0 * CONTACT * x[1]) / CONTACT**2]

    solved = solve_ivp(
        rates, (0.0, 1.0), [0.0, 0.0], t_eval=motion.time[1:], max_step=0.002, rtol=1e-8, atol=1e-10
    ).y  # fmt: skip
    t = motion.time[1:]
    np.testing.assert_allclose(motion.angle[:, 2, 0] - np.sin(omega * t), solved[0], rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(motion.rate[:, 2, 0] - omega * np.cos(omega * t), solved[1], rtol=0.0, atol=0.03)


def test_a_slow_swing_loses_half_the_width_at_either_end_and_half_the_width_on_the_way() -> None:
    """Catches a total width taken for a half one, and a joint that runs ahead of its command."""
    width = 0.2
    motion = BACKLASH.drive(_sinusoid(1.0, 4.0 * np.pi, step=0.02), {"joint_1": width, "contact": CONTACT})
    time = motion.time[:-1]
    angle = motion.angle[time > 2.0 * np.pi, 0, 0]
    command, rate = np.sin(time[time > 2.0 * np.pi]), np.cos(time[time > 2.0 * np.pi])
    assert np.max(angle) == pytest.approx(1.0 - 0.5 * width, abs=2e-3)
    assert np.min(angle) == pytest.approx(-1.0 + 0.5 * width, abs=2e-3)
    driving = np.abs(command) < 0.5
    np.testing.assert_allclose((angle - command)[driving], -0.5 * width * np.sign(rate[driving]), rtol=0.0, atol=2e-3)


def test_the_joint_stays_within_the_gap_and_starts_where_the_command_starts(pike: Fish, turning: Trial) -> None:
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    motion = BACKLASH.drive(command, PLAYS | {"contact": CONTACT})
    assert np.max(np.abs(motion.angle - command.angle)) <= 0.02 + 1e-12
    assert np.max(np.abs(motion.angle - command.angle)) > 0.015
    assert np.array_equal(motion.angle[0, 0], command.angle[0, 0])
    assert np.array_equal(motion.rate[0, 0], command.rate[0, 0])


@pytest.mark.parametrize("short", ["joint_2", "joint_4", "contact"])
@pytest.mark.parametrize("play", [0.01, 0.04])
def test_its_sensitivity_is_that_of_predictions(pike: Fish, turning: Trial, play: float, short: str) -> None:
    """To a hundredth only: a flank that passes a node between steps of the drive bends the prediction there."""
    assert derivative_error(pike, turning, BACKLASH, dict.fromkeys(PLAYS, play) | {"contact": 0.004}, short) < 1e-2


@pytest.mark.parametrize("sizes", [dict.fromkeys(PLAYS, 0.04), {**dict.fromkeys(PLAYS, 0.0), "joint_3": 0.04}])
def test_hidden_play_is_found_again(pike: Fish, sizes: dict[str, float]) -> None:
    """Of all joints, or of one."""
    assert not BACKLASH.smooth
    found = found_again(pike, BACKLASH, sizes)
    assert all(abs(found.values[f"servo_backlash.{short}"] - size) < 0.004 for short, size in sizes.items())


@pytest.mark.parametrize("contact", [0.002, 0.006])
def test_how_hard_the_gears_meet_is_found_with_the_play(pike: Fish, contact: float) -> None:
    """Within its error, which is below a millisecond."""
    sizes = dict.fromkeys(PLAYS, 0.01) | {"contact": contact}
    found = refitted(synthetic(pike, BACKLASH, sizes), BACKLASH)
    assert max(map(abs, deviations(found, BACKLASH, sizes).values())) < 4.0
    assert found.sigma["servo_backlash.contact"] < 0.001
