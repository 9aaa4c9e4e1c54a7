"""The smoothing spline of measured joint angles: rate and acceleration of known signals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline, make_smoothing_spline
from scipy.linalg import eigh

from mjfish.drive.measured import ALLOWED, eased_smoothing, exact, joint_motion, smoothing, smoothing_spline
from mjfish.numerics.arrays import FloatArray

PULSE = 2.0 * np.pi * 1.0
AMPLITUDE = 0.4
NOISE = 0.004
#: Away from the ends, where every smoother of samples knows less.
INNER = np.linspace(0.5, 7.5, 1401)


def _signal(time: FloatArray, order: int = 0) -> FloatArray:
    """Return a beat with a second harmonic, or its derivative."""
    return sum(
        size * (n * PULSE) ** order * np.sin(n * PULSE * time + phase + order * np.pi / 2.0)
        for n, size, phase in ((1, AMPLITUDE, 0.3), (2, 0.1 * AMPLITUDE, 1.1))
    )


def _error(estimate: FloatArray, order: int) -> float:
    """Return the rms error relative to the rms of the derivative."""
    truth = _signal(INNER, order)
    return float(np.sqrt(np.mean((estimate - truth) ** 2) / np.mean(truth**2)))


def _samples(rate: float, seed: int | None) -> tuple[FloatArray, FloatArray]:
    time = np.arange(0.0, 8.0 + 1e-9, 1.0 / rate)
    noise = 0.0 if seed is None else NOISE * np.random.default_rng(seed).standard_normal(len(time))
    return time, _signal(time) + noise


def test_recovers_rate_and_acceleration_of_a_clean_signal() -> None:
    """60 samples a second, no noise: to 1e-6 and 1e-5."""
    spline = smoothing_spline(*_samples(60.0, None))
    assert _error(spline(INNER), 0) < 1e-6
    assert _error(spline(INNER, nu=1), 1) < 1e-6
    assert _error(spline(INNER, nu=2), 2) < 1e-5


@pytest.mark.parametrize("seed", range(6))
def test_recovers_rate_and_acceleration_from_noise(seed: int) -> None:
    """One per cent of noise on the angle: two per cent on the rate, six on the acceleration."""
    spline = smoothing_spline(*_samples(60.0, seed))
    assert _error(spline(INNER), 0) < 0.006
    assert _error(spline(INNER, nu=1), 1) < 0.02
    assert _error(spline(INNER, nu=2), 2) < 0.06


@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_beats_the_cubic_smoothing_spline_in_acceleration(rate: float) -> None:
    """The reason for the fifth degree; over ten noises, so that luck does not decide."""
    ours, cubic = [], []
    for seed in range(10):
        time, samples = _samples(rate, seed)
        ours.append(_error(smoothing_spline(time, samples)(INNER, nu=2), 2))
        cubic.append(_error(make_smoothing_spline(time, samples)(INNER, nu=2), 2))
    assert np.median(ours) < 0.6 * np.median(cubic)
    assert sum(a < b for a, b in zip(ours, cubic, strict=True)) >= 9


def test_the_penalty_is_the_minimum_of_generalised_cross_validation() -> None:
    """Against the definition with the dense hat matrix: no penalty of a fine scan scores better than the one taken."""
    time, samples = (array[:80] for array in _samples(20.0, 8))
    taken = smoothing_spline(time, samples)
    design = BSpline.design_matrix(time, taken.t, 5).toarray()
    points, weights = np.polynomial.legendre.leggauss(3)
    ends = np.unique(taken.t)
    at = (0.5 * (ends[:-1] + ends[1:])[:, None] + 0.5 * np.diff(ends)[:, None] * points).ravel()
    third = BSpline(taken.t, np.eye(len(time)), 5)(at, nu=3)
    rough = third.T @ ((0.5 * np.diff(ends)[:, None] * weights).ravel()[:, None] * third)
    stiffness, modes = eigh(rough, design.T @ design)
    fit, data = design @ modes, (design @ modes).T @ samples
    scan = []
    for penalty in 10.0 ** np.arange(-12.0, -2.0, 0.02):
        kept = 1.0 / (1.0 + penalty * stiffness)
        curve = fit @ (kept * data)
        left = 1.0 - 1.4 * np.sum(kept) / len(time)
        score = np.mean((samples - curve) ** 2) / left**2 if left > 0.0 else np.inf
        scan.append((float(np.max(np.abs(curve - taken(time)))), float(score)))
    distance, score = min(scan)
    assert distance < 2e-4  # the curve taken is one of the scan, and no other scores noticeably better
    assert score == pytest.approx(min(score for _, score in scan), rel=1e-3)
    assert max(score for _, score in scan if np.isfinite(score)) > 2.0 * score


def test_long_records_take_no_longer_than_they_are_long() -> None:
    """Banded throughout: ten minutes at 60 Hz are fitted at once, where dense matrices would take gigabytes."""
    time = np.arange(36000) / 60.0
    spline = smoothing_spline(time, _signal(time) + NOISE * np.random.default_rng(0).standard_normal(len(time)))
    assert _error(spline(INNER, nu=2), 2) < 0.06


def test_the_penalty_follows_the_noise() -> None:
    """More noise, more smoothing: with the penalty fixed the error would grow in proportion or never fall."""
    time, clean = _samples(60.0, None)
    draw = np.random.default_rng(1).standard_normal(len(time))
    errors = [_error(smoothing_spline(time, clean + size * draw)(INNER, nu=2), 2) for size in (1e-4, 1e-3, 1e-2)]
    assert errors[0] < errors[1] < errors[2] < 50.0 * errors[0]


def test_a_polynomial_of_second_degree_is_left_alone() -> None:
    """The penalty is on the third derivative, so that nothing pulls a parabola straight."""
    time = np.sort(np.random.default_rng(2).random(80))
    parabola = 0.3 - 1.2 * time + 2.5 * time**2
    spline = smoothing_spline(time, parabola)
    np.testing.assert_allclose(spline(time), parabola, atol=1e-9)
    np.testing.assert_allclose(spline(np.linspace(time[0], time[-1], 50), nu=2), 5.0, atol=1e-5)


def test_uneven_samples_are_no_trouble() -> None:
    """Times of a camera that loses frames."""
    time, samples = _samples(60.0, 3)
    keep = np.random.default_rng(4).random(len(time)) > 0.2
    spline = smoothing_spline(time[keep], samples[keep])
    assert _error(spline(INNER, nu=1), 1) < 0.03


def test_the_motion_carries_the_spline_and_its_derivatives_on_the_half_step_grid() -> None:
    time, first = _samples(60.0, 5)
    angles = np.stack([first, -2.0 * first + 0.1], axis=1)
    motion = joint_motion(time + 3.0, angles, 0.005)
    assert motion.joints == 2
    assert (motion.time[0], motion.time[-1]) == pytest.approx((3.0, 11.0))
    assert np.max(np.diff(motion.time)) <= 0.005 + 1e-9
    spline = smoothing_spline(time + 3.0, first)
    stage = 0.5 * (motion.time[:-1] + motion.time[1:])
    for order, field in enumerate((motion.angle, motion.rate, motion.acceleration)):
        np.testing.assert_allclose(field[:, 1, 0], spline(stage, nu=order), atol=1e-9)
        np.testing.assert_array_equal(field[1:, 0], field[:-1, 2])  # nothing jumps
    np.testing.assert_allclose(motion.rate[:, 1, 1], -2.0 * motion.rate[:, 1, 0], atol=1e-6)


#: Posterior standard deviation in the middle between two exact samples, by the root of q h^5.
BETWEEN = 0.02603


def test_between_exact_samples_a_step_is_off_by_what_is_said() -> None:
    """A command that goes by 0.3 rad, at once or within half a sample, somewhere between the 25th sample and the next.

    There the error in units of what is said is three quarters, rms; nowhere is it more. Fifteen samples away next to
    nothing is said.
    """
    rng, time = np.random.default_rng(4), 0.02 * np.arange(60)
    middle, errors, said = 0.5 * (time[:-1] + time[1:]), [], []
    for begins, lasts in zip(rng.uniform(0.5, 0.52, 400), rng.uniform(0.0005, 0.01, 400), strict=True):

        def command(t: FloatArray, begins: float = begins, lasts: float = lasts) -> FloatArray:
            return 0.4 * np.sin(6.0 * t) + 0.3 * -np.expm1(-np.maximum(t - begins, 0.0) / lasts)

        found = exact(time, command(time))
        said.append(BETWEEN * np.sqrt(found.intensity * np.diff(time) ** 5))
        errors.append(found.spline(middle) - command(middle))
    off = np.sqrt(np.mean((np.array(errors) / np.array(said)) ** 2, axis=0))
    assert off[25] == pytest.approx(0.75, abs=0.15)
    assert off[3:-3].argmax() == 22
    assert np.mean(said, axis=0)[[10, 40]].max() < 0.001


@pytest.mark.parametrize(("samples", "more"), [(5.5, 4.0), (9.0, 80.0), (20.0, 12.0)])
def test_of_a_beat_more_is_said_than_its_spline_misses(samples: float, more: float) -> None:
    """So many samples a beat with a third harmonic: between the error and so many times it is said.

    Of twenty samples a beat every fourth one shows it, and little more than what is missed is said. Of
    five and a half not even all are enough: every fourth one misses the beat itself, and all is said.
    """
    time = np.arange(200) / samples
    middle = 0.5 * (time[:-1] + time[1:])[20:-20]

    def beat(t: FloatArray) -> FloatArray:
        return np.sin(2.0 * np.pi * t) + 0.02 * np.sin(6.0 * np.pi * t + 1.0)

    found = exact(time, beat(time))
    said = BETWEEN * np.sqrt(found.intensity * np.diff(time) ** 5)[20:-20]
    off = np.abs(found.spline(middle) - beat(middle))
    assert off.max() < said.min() < said.max() < more * off.max()


def test_a_command_that_begins_at_once_is_followed() -> None:
    """Between the first samples of a tail that goes to its beat within two, a spline of free ends is five times as far.

    It begins at -11 rad/s. A beat that begins with its whole rate is followed, too.
    """
    time, fine = np.arange(0.0, 1.0, 1.0 / 30.0), np.linspace(0.0, 0.1, 101)

    def sudden(t: FloatArray) -> FloatArray:
        return -0.3 * np.expm1(-((t / 0.05) ** 3)) * np.sin(9.0 * t + 1.0)

    free = make_interp_spline(time, sudden(time), k=5)
    natural = exact(time, sudden(time)).spline
    np.testing.assert_allclose(natural(time), sudden(time), atol=1e-12)
    missed, missed_free = (np.abs(spline(fine) - sudden(fine)).max() for spline in (natural, free))
    assert missed < 0.01 < 0.05 < missed_free
    beat = exact(time, 0.3 * np.sin(10.0 * time)).spline
    assert float(beat(0.0, nu=1)) == pytest.approx(3.0, rel=0.03)


def test_so_few_samples_are_interpolated_too() -> None:
    time = 0.1 * np.arange(7)
    assert np.all(np.isfinite(exact(time, time**2).intensity))


def test_an_abrupt_change_is_allowed_for_where_it_is() -> None:
    """A bias that a joint reaches within 20 ms, at 100 samples a second; one penalty is too little for all else."""
    time = np.arange(0.0, 6.0, 0.01)
    beat = _signal(time) + NOISE * np.random.default_rng(0).standard_normal(len(time))
    turned = beat + 0.5 / (1.0 + np.exp((3.004 - time) / 0.005))
    plain, found = smoothing(time, turned, ALLOWED), eased_smoothing(time, turned, ALLOWED)
    assert found.sigma == pytest.approx(NOISE, rel=0.1)
    eased = np.flatnonzero(found.intensity > 10.0 * found.intensity.min())
    assert np.abs(time[eased] - 3.0).max() < 0.06
    assert found.intensity.max() > 30.0 * plain.intensity.max()
    assert found.intensity.min() < 0.1 * plain.intensity.min()
    assert np.array_equal(eased_smoothing(time, beat, ALLOWED).spline.c, smoothing(time, beat, ALLOWED).spline.c)
