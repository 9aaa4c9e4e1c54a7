"""The Hopf-oscillator CPG: its figures, its rates and accelerations, its segments."""

from __future__ import annotations

import numpy as np
import pytest
from referee import Referee
from scipy.integrate import solve_ivp

from mjfish.drive import cpg
from mjfish.drive.cpg import ZETA_START, DriveSegment
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray

STRAIGHT = (0.0, 0.0, 0.0, 0.0)
CHANGING = (
    DriveSegment(0.0, 18.0, STRAIGHT),
    DriveSegment(0.4, 26.0, STRAIGHT),
    DriveSegment(0.7, 26.0, (0.0, 1.0, 1.5, 2.0)),
)


def _gain(fish: Fish) -> float:
    assert fish.cpg is not None
    return fish.cpg.beta * fish.cpg.unit


def _slow(fish: Fish, segments: tuple[DriveSegment, ...], time: FloatArray) -> FloatArray:
    """Return zeta and psi (8, m) by the referee's own right-hand side and a high-order integrator."""
    referee = Referee(fish)
    state = np.concatenate([np.full(4, ZETA_START), segments[0].bias])
    columns = []
    for segment, end in zip(segments, [*(s.start for s in segments[1:]), time[-1] + 1e-9], strict=True):
        at = time[(time >= segment.start) & (time < end)]
        outcome = solve_ivp(
            lambda _t, y, now=segment: np.concatenate(referee.oscillators(y, now)),
            (segment.start, end),
            state,
            method="DOP853",
            dense_output=True,
            rtol=1e-12,
            atol=1e-13,
        )
        columns.append(outcome.sol(at))
        state = outcome.y[:, -1]
    return np.concatenate(columns, axis=1)


def _settled(fish: Fish, omega: float) -> tuple[JointMotion, FloatArray, FloatArray]:
    """Return a long straight drive, times of its last five beats and psi there (m, 4)."""
    motion = cpg.joint_motion(fish.cpg, (DriveSegment(0.0, omega, STRAIGHT),), 14.0, 0.002)
    time = np.linspace(14.0 - 5 * 2.0 * np.pi / (0.996 * omega), 14.0, 20001)
    return motion, time, motion.angle_at(time) / _gain(fish)


def test_amplitudes_are_those_of_the_coupled_oscillators_not_the_roots_of_a(pike: Fish) -> None:
    """Psi = 3.61, 4.91, 5.58, 6.38 at omega = 18. Uncoupled they would be sqrt(A) = 2.95, 4.37, 5.05, 6.36."""
    _, _, psi = _settled(pike, 18.0)
    assert 0.5 * np.ptp(psi, axis=0) == pytest.approx([3.61, 4.91, 5.58, 6.38], abs=0.005)
    assert pike.cpg is not None
    assert abs(0.5 * np.ptp(psi[:, 0]) - np.sqrt(pike.cpg.amplitude[0])) > 0.5


def test_beat_frequency_and_lags_between_joints(pike: Fish) -> None:
    """0.996 omega; 68.4, 70.2, 66.9 degrees from each joint to the next, from head to tail (of the fundamental)."""
    motion, _, _ = _settled(pike, 18.0)
    time = np.linspace(4.0, 14.0, 200001)
    first = motion.angle_at(time)[:, 0]
    rising = np.flatnonzero((first[:-1] < 0.0) & (first[1:] >= 0.0))
    crossings = time[rising] - first[rising] / (first[rising + 1] - first[rising]) * (time[1] - time[0])
    pulse = 2.0 * np.pi / np.mean(np.diff(crossings))
    assert pulse / 18.0 == pytest.approx(0.996, abs=5e-4)
    beats = np.linspace(crossings[0], crossings[10], 4001)[:-1]
    phases = np.angle(np.exp(-1j * pulse * beats) @ motion.angle_at(beats))
    lags = np.degrees(-np.diff(phases)) % 360.0
    assert lags == pytest.approx([68.4, 70.2, 66.9], abs=0.06)


def test_one_unit_is_a_tenth_of_a_degree(pike: Fish) -> None:
    """Unit of beta psi, assumed: theta_i = 6 degrees psi_i."""
    assert _gain(pike) == pytest.approx(np.radians(6.0))


def test_angles_equal_a_high_order_integration_over_two_changes(pike: Fish) -> None:
    motion = cpg.joint_motion(pike.cpg, CHANGING, 1.0, 0.001)
    time = np.linspace(0.0, 1.0, 401)
    expected = _gain(pike) * _slow(pike, CHANGING, time)[4:].T
    np.testing.assert_allclose(motion.angle_at(time), expected, rtol=0.0, atol=1e-7)


def test_rates_and_accelerations_are_exact_not_differences(pike: Fish) -> None:
    """Against the right-hand side and its complex-step derivative along the flow, at the start of every step."""
    motion = cpg.joint_motion(pike.cpg, CHANGING, 1.0, 0.001)
    referee = Referee(pike)
    state = _slow(pike, CHANGING, motion.time[:-1])
    tiny = 1e-30
    for step in range(0, len(motion.time) - 1, 7):
        segment = [s for s in CHANGING if s.start <= motion.time[step] + 1e-9][-1]
        flow = np.concatenate(referee.oscillators(state[:, step], segment))
        bent = np.concatenate(referee.oscillators(state[:, step] + 1j * tiny * flow, segment))[4:].imag / tiny
        np.testing.assert_allclose(motion.rate[step, 0], _gain(pike) * flow[4:], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(motion.acceleration[step, 0], _gain(pike) * bent, rtol=0.0, atol=2e-5)


def test_rates_and_accelerations_are_the_derivatives_of_the_angles(pike: Fish) -> None:
    """Over each half step: Hermite quadrature of the acceleration gives the change of rate, and so on up."""
    motion = cpg.joint_motion(pike.cpg, CHANGING, 1.0, 0.0005)
    half = 0.5 * np.diff(motion.time)[:, None]
    for first, second in ((0, 1), (1, 2)):
        change = motion.angle[:, second] - motion.angle[:, first]
        mean = 0.5 * (motion.rate[:, first] + motion.rate[:, second]) * half
        bend = (motion.acceleration[:, first] - motion.acceleration[:, second]) * half**2 / 12.0
        np.testing.assert_allclose(change, mean + bend, rtol=0.0, atol=1e-11)
        gained = motion.rate[:, second] - motion.rate[:, first]
        trapezoid = 0.5 * (motion.acceleration[:, first] + motion.acceleration[:, second]) * half
        np.testing.assert_allclose(gained, trapezoid, rtol=0.0, atol=1e-5)


def test_the_integration_is_of_fourth_order(pike: Fish) -> None:
    """The oscillators' start is fast (A up to 40 1/s), so the asymptotic order shows at small steps only."""
    drive = (DriveSegment(0.0, 18.0, STRAIGHT),)
    time = np.linspace(0.0, 0.5, 11)
    expected = _gain(pike) * _slow(pike, drive, time)[4:].T

    def worst(step: float) -> float:
        return float(np.max(np.abs(cpg.joint_motion(pike.cpg, drive, 0.5, step).angle_at(time) - expected)))

    errors = [worst(0.005 / 2**k) for k in range(5)]
    assert errors[0] < 1e-4
    assert np.mean(np.log2(np.array(errors[:-1]) / np.array(errors[1:]))) == pytest.approx(4.0, abs=0.3)


def test_starts_with_every_oscillator_at_its_bias(pike: Fish) -> None:
    """psi_i = b_i and zeta_i = 0.1 at t = 0; the rate is then that of eq. (20), not zero."""
    bias = (0.5, 0.0, -1.0, 2.0)
    motion = cpg.joint_motion(pike.cpg, (DriveSegment(0.0, 18.0, bias),), 0.1, 0.005)
    assert motion.angle[0, 0] == pytest.approx(_gain(pike) * np.array(bias))
    behind = 5.0 * 0.1 * np.sin(np.radians(70.0))
    assert motion.rate[0, 0] == pytest.approx(_gain(pike) * (1.8 + np.array([behind, behind, behind, 0.0])))


def test_angle_is_continuous_and_the_rate_jumps_where_the_input_changes(pike: Fish) -> None:
    motion = cpg.joint_motion(pike.cpg, CHANGING, 1.0, 0.004)
    np.testing.assert_allclose(motion.angle[1:, 0], motion.angle[:-1, 2], rtol=0.0, atol=1e-15)
    sizes = np.max(np.abs(motion.rate[1:, 0] - motion.rate[:-1, 2]), axis=1)
    assert motion.time[1:-1][sizes > 1e-6] == pytest.approx([0.4, 0.7])
    assert np.min(sizes[sizes > 1e-6]) > 0.5


def test_a_bias_shifts_the_mean_angle_of_its_joint(pike: Fish) -> None:
    """Directional bias: psi swings about b."""
    bias = (0.0, 1.0, 1.5, 2.0)
    motion = cpg.joint_motion(pike.cpg, (DriveSegment(0.0, 18.0, bias),), 14.0, 0.005)
    beat = 2.0 * np.pi / (0.996 * 18.0)
    psi = motion.angle_at(np.linspace(14.0 - 10 * beat, 14.0, 20001)) / _gain(pike)
    assert 0.5 * (psi.max(axis=0) + psi.min(axis=0)) == pytest.approx(bias, abs=0.02)


def test_the_chain_may_have_any_number_of_joints(pike: Fish) -> None:
    """A single oscillator has no neighbours: amplitude sqrt(A), frequency omega, exactly."""
    assert pike.cpg is not None
    single = pike.cpg.model_copy(update={"amplitude": (9.0,)})
    motion = cpg.joint_motion(single, (DriveSegment(0.0, 15.0, (0.0,)),), 5.0, 0.002)
    assert motion.joints == 1
    psi = motion.angle_at(np.linspace(3.0, 5.0, 20001)) / _gain(pike)
    assert 0.5 * np.ptp(psi) == pytest.approx(3.0, rel=1e-6)


def test_segments_after_the_end_have_no_effect(pike: Fish) -> None:
    short = cpg.joint_motion(pike.cpg, CHANGING, 0.3, 0.005)
    alone = cpg.joint_motion(pike.cpg, CHANGING[:1], 0.3, 0.005)
    assert np.array_equal(short.angle, alone.angle)


def test_a_wrong_number_of_biases_is_refused_by_its_segment(pike: Fish) -> None:
    drive = (CHANGING[0], DriveSegment(0.4, 18.0, (0.0, 0.0)))
    with pytest.raises(InputError, match=r"segment at 0\.4 s has 2 biases.* 4 joints"):
        cpg.joint_motion(pike.cpg, drive, 1.0, 0.005)


@pytest.mark.parametrize("second", [0.0, -1.0, 0.4, np.nan])
def test_segments_out_of_order_are_refused(pike: Fish, second: float) -> None:
    drive = (*CHANGING[:2], DriveSegment(second, 18.0, STRAIGHT))
    with pytest.raises(InputError, match=r"follows one at 0\.4 s; sort the segments"):
        cpg.joint_motion(pike.cpg, drive, 1.0, 0.005)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan])
def test_a_drive_of_no_length_is_refused(pike: Fish, duration: float) -> None:
    with pytest.raises(InputError, match="expected a positive one"):
        cpg.joint_motion(pike.cpg, CHANGING, duration, 0.005)


@pytest.mark.parametrize("drive", [(), (DriveSegment(0.5, 18.0, STRAIGHT),)])
def test_a_drive_that_does_not_start_at_zero_is_refused(pike: Fish, drive: tuple[DriveSegment, ...]) -> None:
    with pytest.raises(InputError, match="must start at 0 s"):
        cpg.joint_motion(pike.cpg, drive, 1.0, 0.005)
