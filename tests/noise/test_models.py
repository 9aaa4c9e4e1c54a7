"""Noise as the diagnosis sees it: every model whitens what it describes, from the first sample, with gaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from mjfish.diagnosis.evidence import signatures
from mjfish.effects import find
from mjfish.estimation import Fit, Noise, Problem
from mjfish.estimation import fit as fitted
from mjfish.estimation.noise_of_fit import noise_of, noise_sample, state_jacobians
from mjfish.estimation.omnibus import HATS, by_channel, functions, hats
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.noise import (
    Autoregressive,
    DifferentiationNoise,
    GaussMarkov,
    NoiseByRate,
    ProcessNoise,
    differentiation_noise,
    estimate,
    gauss_markov,
    process_noise,
)
from mjfish.noise.sample import remaining_power
from mjfish.noise.spectral import sharpened
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.numerics.sized_cache import always
from mjfish.simulation.synthetic import generate

SIGMA = readonly([0.01, 0.02, 0.05])
STEP = 0.02
COLOURED = Autoregressive(SIGMA, readonly([[0.6, -0.3], [1.2, -0.5], [0.9, 0.0]]))
DRIFTING = GaussMarkov(SIGMA, drift=readonly(2.0 * SIGMA), time=readonly([0.2, 0.5, 1.0]))
ROUGH = DifferentiationNoise(SIGMA, window=9, degree=4, rounding=0.1)
JACOBIAN = np.array([[-1.0, 0.3, 0.1], [0.0, -4.0, 0.5], [0.0, -8.0, -9.0]])
PUSHED = ProcessNoise(
    SIGMA, push=readonly([0.1, 0.3, 2.0]), time=0.3, jacobians={"run": np.tile(JACOBIAN, (400, 1, 1))}
)


def _trial(samples: int) -> Any:
    return SimpleNamespace(name="run", time=STEP * np.arange(samples), step=STEP)


def _coloured(rng: np.random.Generator, samples: int) -> FloatArray:
    """Draw it by its recursion, from long before the first sample."""
    warm = 40
    white = SIGMA * rng.standard_normal((warm + samples, 3))
    series = [signal.lfilter([1.0], [1.0, *-COLOURED.phi[c]], white[:, c])[warm:] for c in range(3)]
    return np.stack(series, axis=1)


def _drifting(rng: np.random.Generator, samples: int, time: FloatArray = DRIFTING.time) -> FloatArray:
    decay = np.exp(-STEP / time)
    wander = np.empty((samples, 3))
    wander[0] = rng.standard_normal(3) * DRIFTING.drift
    for t in range(1, samples):
        wander[t] = decay * wander[t - 1] + np.sqrt(1.0 - decay**2) * DRIFTING.drift * rng.standard_normal(3)
    return wander + SIGMA * rng.standard_normal((samples, 3))


def _rough(rng: np.random.Generator, samples: int, rounding: float = ROUGH.rounding) -> FloatArray:
    """Differentiate white positions by scipy's filter, away from its ends, and add what rounding adds."""
    ends = 2 * ROUGH.window
    places = rng.standard_normal((samples + 2 * ends, 3))
    slopes = signal.savgol_filter(places, ROUGH.window, ROUGH.degree, deriv=1, axis=0)[ends:-ends]
    gain = np.linalg.norm(signal.savgol_coeffs(ROUGH.window, ROUGH.degree, deriv=1))
    both = slopes / gain + rounding * rng.standard_normal((samples, 3))
    return SIGMA * both / np.sqrt(1.0 + rounding**2)


def _pushed(rng: np.random.Generator, samples: int) -> FloatArray:
    """Integrate the pushed deviation by ten small steps a sample: another discretisation than the filter's."""
    fine, push, v = 10, rng.standard_normal(3) * PUSHED.push, np.zeros(3)
    h, out = STEP / fine, np.empty((samples, 3))
    for t in range(samples):
        out[t] = v
        for _ in range(fine):
            v = v + h * (JACOBIAN @ v + push)
            push = push * (1.0 - h / PUSHED.time) + np.sqrt(2.0 * h / PUSHED.time) * PUSHED.push * rng.standard_normal(
                3
            )
    return out + SIGMA * rng.standard_normal((samples, 3))


@pytest.mark.parametrize("gaps", [pytest.param(False, marks=pytest.mark.slow), True], ids=["whole", "gaps"])
@pytest.mark.parametrize(
    ("noise", "draw"),
    [(COLOURED, _coloured), (DRIFTING, _drifting), (ROUGH, _rough), (PUSHED, _pushed)],
    ids=["ar", "drift", "differentiated", "forces"],
)
def test_noise_is_whitened_from_the_first_sample_on_and_over_gaps(
    noise: Any, draw: Callable[[np.random.Generator, int], FloatArray], gaps: bool
) -> None:
    """Unit variance in the first samples, in the rest, and no correlation. Catches a start that is not stationary."""
    rng = np.random.default_rng(3)
    samples, trial = 400, _trial(400)
    mask = rng.random(samples) > 0.1 if gaps else np.ones(samples, dtype=np.bool_)
    white = np.stack([noise.whiten(trial, mask, draw(rng, samples)[mask]) for _ in range(60)])
    count = white.size / 3.0
    assert white.shape[1] == np.count_nonzero(mask)
    np.testing.assert_allclose(white[:, :5].std(axis=(0, 1)), 1.0, atol=5.0 / np.sqrt(2 * 300))
    np.testing.assert_allclose(white.std(axis=(0, 1)), 1.0, atol=5.0 / np.sqrt(2 * count) + 0.01)
    for lag in (1, 2, 5, 20):
        product = np.mean(white[:, lag:] * white[:, :-lag], axis=(0, 1))
        assert np.all(np.abs(product) < 5.0 / np.sqrt(count) + 0.01), lag


@pytest.mark.parametrize("noise", [COLOURED, DRIFTING, ROUGH, PUSHED], ids=["ar", "drift", "differentiated", "forces"])
def test_the_log_determinant_is_that_of_the_filter(noise: Any) -> None:
    """Whitening is a triangular matrix L^-1: log det of the covariance is -2 sum log of its diagonal."""
    samples = 60
    mask: BoolArray = np.ones(samples, dtype=np.bool_)
    trial = _trial(samples)
    unit = np.eye(3 * samples).reshape(samples, 3, 3 * samples)
    matrix = noise.whiten(trial, mask, unit).reshape(3 * samples, 3 * samples)
    expected = -2.0 * float(np.linalg.slogdet(matrix)[1])
    assert noise.log_determinant(trial, mask) == pytest.approx(expected, rel=1e-9)


@pytest.fixture(scope="module")
def swum(pike: Fish) -> tuple[Problem, Fit]:
    """A fit of two synthetic trials without noise, to hang noise on."""
    dataset = generate(pike, ["v1", "v5"], noise=np.full(3, 1e-6), duration=6.0, seed=1, held_out=[])
    problem = Problem(Model(dataset.fish), dataset.trials, Noise.white(SIGMA))
    return problem, fitted(problem, tolerance=1e-4)


@pytest.fixture(scope="module")
def pike() -> Fish:
    """The shipped fish."""
    return load_fish("pike")


def test_drift_is_found_and_is_likelier_than_an_autoregression(swum: tuple[Problem, Fit]) -> None:
    problem, _ = swum
    rng = np.random.default_rng(5)
    blocks = [_drifting(rng, int(problem.mask(i).sum())) for i in range(2)]
    left = noise_sample(problem, blocks)
    found = gauss_markov(left, remaining_power(left))
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.2)
    np.testing.assert_allclose(found.drift, DRIFTING.drift, rtol=0.5)
    fair = Noise.white(np.sqrt(np.mean(np.concatenate(blocks) ** 2, axis=0)))
    assert left.log_likelihood(found) > left.log_likelihood(fair) + 100.0


def test_noise_of_residuals_that_are_moved_by_rounding_is_the_same(swum: tuple[Problem, Fit]) -> None:
    """Catches gradients by differences, which make 1e-5 of what is rounded."""
    problem, one = swum
    rng = np.random.default_rng(12)
    blocks = [_drifting(rng, int(problem.mask(i).sum())) for i in range(2)]
    moved = [block * (1.0 + 1e-13 * rng.standard_normal(block.shape)) for block in blocks]
    jacobians = state_jacobians(problem, one.values)
    for of in (lambda left: gauss_markov(left, remaining_power(left)), lambda left: process_noise(left, jacobians)):
        here, there = (of(noise_sample(problem, each)) for each in (blocks, moved))
        np.testing.assert_allclose(there.sigma, here.sigma, rtol=1e-9)


def test_the_low_end_of_a_drift_of_any_time_is_right(swum: tuple[Problem, Fit]) -> None:
    """Slow effects are weighed by it; a time that is rounded to a grid makes it a half or twice as large."""
    problem = replace(swum[0], trials=5 * swum[0].trials)
    rng = np.random.default_rng(8)
    time = readonly([0.3, 0.3, 0.3])
    ratios = []
    for _ in range(10):
        blocks = [_drifting(rng, int(problem.mask(i).sum()), time) for i in range(10)]
        found = _gauss_markov(problem, blocks)
        ratios.append(found.drift**2 * found.time / (DRIFTING.drift**2 * time))
    assert np.median(np.abs(np.log(ratios))) < 0.35
    assert abs(np.median(np.log(ratios))) < 0.2


@pytest.mark.slow
def test_the_uncertainty_of_a_drift_in_a_short_recording_is_stated(swum: tuple[Problem, Fit]) -> None:
    """The power of its low end, the truth, is among the draws. Catches draws that are too close, or about elsewhere."""
    problem, _ = swum
    rng = np.random.default_rng(21)
    low = []
    for _ in range(25):
        blocks = [_drifting(rng, int(problem.mask(i).sum())) for i in range(2)]
        found = _gauss_markov(problem, blocks)
        powers = np.array([np.log(one.drift**2 * one.time) for one in found.likely])
        low.append(np.mean(powers < np.log(DRIFTING.drift**2 * DRIFTING.time), axis=0))
    rank = np.ravel(low)
    assert 0.85 < np.mean((rank > 0.02) & (rank < 0.98)) <= 1.0
    assert np.mean((rank > 0.25) & (rank < 0.75)) < 0.75


def test_a_drift_is_not_underestimated_where_the_saturated_model_absorbs_slow_noise(
    swum: tuple[Problem, Fit],
) -> None:
    """Five slow waves a trial and channel are taken out. Catches spectra and likelihoods that do not know of it."""
    problem, _ = swum
    rng = np.random.default_rng(9)
    counts = [int(problem.mask(i).sum()) for i in range(2)]
    waves = [np.cos(np.pi * np.outer((np.arange(n) + 0.5) / n, np.arange(5))) for n in counts]
    span = [np.zeros((n, 3, 30)) for n in counts]
    blocks = []
    for i, (n, wave) in enumerate(zip(counts, waves, strict=True)):
        basis = np.linalg.qr(wave)[0]
        for c in range(3):
            span[i][:, c, 15 * i + 5 * c : 15 * i + 5 * (c + 1)] = basis * SIGMA[c]
        noise = _drifting(rng, n)
        blocks.append(noise - basis @ (basis.T @ noise))
    left = replace(noise_sample(problem, blocks), span=span, lost=10.0)
    found = gauss_markov(left, remaining_power(left))
    blind = _gauss_markov(problem, blocks)
    slow = [one.drift**2 * one.time / (DRIFTING.drift**2 * DRIFTING.time) for one in (found, blind)]
    # What nobody sees any more cannot come back, but all else does; most is lost of what is slowest.
    assert np.all(slow[0] > 1.2 * slow[1]), slow
    assert slow[0][2] > 3.0 * slow[1][2], slow
    assert left.log_likelihood(found) > left.log_likelihood(blind) + 5.0


def test_what_the_saturated_model_takes_is_weighed_by_sigma_and_not_by_unit(swum: tuple[Problem, Fit]) -> None:
    """Waves that all channels share cost each the same share of its power, however large its numbers are."""
    problem, _ = swum
    counts = [int(problem.mask(i).sum()) for i in range(2)]
    span = [
        np.cos(np.pi * np.outer((np.arange(n) + 0.5) / n, np.arange(9)))[:, None, :] * SIGMA[:, None] for n in counts
    ]
    share = remaining_power(replace(noise_sample(problem, [np.zeros((n, 3)) for n in counts]), span=span, lost=3.0))
    assert 0.6 < share[0].min() < share[0].max() < 0.97
    np.testing.assert_allclose(share[-1], 1.0, atol=0.02)


def test_the_filter_of_differentiated_positions_is_found_and_is_likelier_than_an_autoregression(
    swum: tuple[Problem, Fit],
) -> None:
    """What counts is the deep valley at low frequencies: an autoregression sees a slow effect there far worse."""
    problem, _ = swum
    rng = np.random.default_rng(8)
    blocks = [_rough(rng, int(problem.mask(i).sum())) for i in range(2)]
    found = differentiation_noise(noise_sample(problem, blocks))
    assert (found.window, found.degree, found.rounding) == (ROUGH.window, ROUGH.degree, ROUGH.rounding)
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.1)
    coloured, left = estimate(blocks), noise_sample(problem, blocks)
    assert left.log_likelihood(found) > left.log_likelihood(coloured)
    trial, mask = problem.trials[0], problem.mask(0)
    slow = np.sin(np.pi * np.arange(mask.sum()) / mask.sum())[:, None] * SIGMA
    seen = {noise: float(np.sum(noise.whiten(trial, mask, slow) ** 2)) for noise in (found, coloured)}
    assert seen[found] > 2.0 * seen[coloured]


def _shapes(problem: Problem) -> list[FloatArray]:
    cpg = problem.model.fish.cpg
    waves = [by_channel(functions(cpg, trial, trial.time), range(3), 3) for trial in problem.trials]
    return [own[problem.mask(i)] for i, own in enumerate(waves)]


@pytest.mark.parametrize("rounding", [0.03, pytest.param(0.07, marks=pytest.mark.slow), 0.15])
def test_rounding_is_estimated_where_the_saturated_model_absorbs_slow_noise(
    swum: tuple[Problem, Fit], rounding: float
) -> None:
    """Taking shapes out with white weights stirs up the valley at frequency nought, and rounding looks larger."""
    problem, _ = swum
    found = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        blocks = [_rough(rng, int(problem.mask(i).sum()), rounding) for i in range(2)]
        left = replace(noise_sample(problem, blocks), shapes=[*map(always, _shapes(problem))]).without_shapes()
        plain = differentiation_noise(left)
        sharp = sharpened(plain, left)
        assert left.log_likelihood(sharp) > left.log_likelihood(plain)
        found.append([sharp.rounding / rounding, *sharp.sigma / SIGMA])
    np.testing.assert_allclose(np.median(found, axis=0), 1.0, atol=0.15)


def test_a_slow_misfit_is_not_taken_for_rounding(swum: tuple[Problem, Fit]) -> None:
    """Rounding is white: where the filter stops fast noise, too, it is as small as it is."""
    problem, _ = swum
    shapes, found = _shapes(problem), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        blocks = [_rough(rng, int(problem.mask(i).sum()), 0.05) for i in range(2)]
        for block, rows in zip(blocks, shapes, strict=True):
            block += (
                0.2 * SIGMA * (hats(np.arange(float(len(rows))), 0.0, len(rows) - 1.0) @ rng.standard_normal((HATS, 3)))
            )
        left = replace(noise_sample(problem, blocks), shapes=[*map(always, shapes)])
        sharp = sharpened(differentiation_noise(left), left)
        found.append(sharp.rounding / 0.05)
    np.testing.assert_allclose(np.median(found), 1.0, atol=0.2)


def test_white_noise_has_no_forces_behind_it(swum: tuple[Problem, Fit]) -> None:
    """Seven free numbers gain 3.5 on average against the true ones; the rule asks for ten more than that of another."""
    problem, one = swum
    rng = np.random.default_rng(6)
    blocks = [SIGMA * rng.standard_normal((int(problem.mask(i).sum()), 3)) for i in range(2)]
    left = noise_sample(problem, blocks)
    found = process_noise(left, state_jacobians(problem, one.values))
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.12)
    assert left.log_likelihood(found) < left.log_likelihood(Noise.white(SIGMA)) + 6.0


def test_trials_at_two_steps_have_a_noise_each(pike: Fish) -> None:
    """One record is thinned to every second sample: what is correlated in one is hardly so in the other.

    Catches one autoregression, whose numbers count in samples, for both.
    """
    dataset = generate(pike, ["v1", "v5"], noise=np.full(3, 1e-6), duration=8.0, seed=1, held_out=[])
    rng = np.random.default_rng(9)
    whole, thin = (
        replace(trial, velocity=readonly(trial.velocity + _coloured(rng, len(trial.time)))) for trial in dataset.trials
    )
    thin = replace(thin, time=readonly(thin.time[::2]), velocity=readonly(thin.velocity[::2]))
    problem = Problem(Model(dataset.fish), (whole, thin), Noise.white(SIGMA))
    one = fitted(problem, tolerance=1e-4)
    known = signatures(problem, one.values, [find("linear_drag")]).velocity
    noise, told = noise_of(problem, one, known, None)
    assert isinstance(noise, NoiseByRate)
    assert set(noise.models) == {0.02, 0.04}
    assert "every 0.02 s" in told
    assert "every 0.04 s" in told
    for i, trial in enumerate(problem.trials):
        white = noise.whiten(trial, problem.mask(i), problem.raw(one.x)[i])
        np.testing.assert_allclose(white.std(axis=0), 1.0, atol=0.25)
        product = np.mean(white[1:] * white[:-1], axis=0)
        assert np.all(np.abs(product) < 5.0 / np.sqrt(len(white)))


def test_a_noise_free_channel_does_not_reduce_the_noise_of_the_others(swum: tuple[Problem, Fit]) -> None:
    """Surge without noise is held at the floor; sway with long memory keeps its whole spread."""
    problem, one = swum
    slow = Autoregressive(SIGMA, readonly([[0.0], [0.97], [0.0]]))
    rng = np.random.default_rng(10)
    trials = []
    for trial in problem.trials:
        white = rng.standard_normal((len(trial.time) + 200, 3)) * SIGMA
        series = np.stack([signal.lfilter([1.0], [1.0, *-slow.phi[c]], white[:, c])[200:] for c in range(3)], axis=1)
        trials.append(replace(trial, velocity=readonly(trial.velocity + series * [0.0, 1.0, 1.0])))
    noisy = replace(problem, trials=tuple(trials))
    noise, _ = noise_of(noisy, one, signatures(noisy, one.values, [find("linear_drag")]).velocity, None)
    left = np.concatenate(noisy.raw(one.x))
    assert noise.sigma[1] == pytest.approx(left[:, 1].std(), rel=0.25)


def test_a_constant_offset_of_each_run_is_not_taken_for_noise(swum: tuple[Problem, Fit]) -> None:
    """Every run is off by a constant: a wander of a third of a run cannot say all of that, and leaves it to be seen."""
    problem, _ = swum
    rng = np.random.default_rng(8)
    counts = [int(problem.mask(i).sum()) for i in range(2)]
    blocks = [SIGMA * (rng.standard_normal((n, 3)) + off) for n, off in zip(counts, (1.5, -1.5), strict=True)]
    found = _gauss_markov(problem, blocks)
    longest = max(float(trial.time[-1] - trial.time[0]) for trial in problem.trials)
    assert np.all(found.time <= longest / 3.0)
    assert np.all(found.drift > 0.5 * SIGMA)


def _gauss_markov(problem: Problem, blocks: list[FloatArray]) -> GaussMarkov:
    left = noise_sample(problem, blocks)
    return gauss_markov(left, remaining_power(left))


def _with_noise(problem: Problem, draws: Sequence[Callable[[int], FloatArray]]) -> Problem:
    """Return the problem with what `draws` return of so many samples added to the velocities of its trials."""
    trials = [
        replace(trial, velocity=readonly(trial.velocity + draw(len(trial.time))))
        for trial, draw in zip(problem.trials, draws, strict=True)
    ]
    return replace(problem, trials=tuple(trials))


def _noise_found(problem: Problem, fit: Fit) -> tuple[Noise, str]:
    """Return the noise where no cause may explain anything, and it in words."""
    return noise_of(problem, fit, [np.zeros((len(trial.time), 3, 1)) for trial in problem.trials], None)


@pytest.mark.parametrize(
    ("pattern", "told"),
    [
        (lambda sign, n: np.full((n, 1), 1.5 * sign), "runs differ in level"),
        (lambda sign, n: 1.5 * np.cos(np.linspace(0.0, np.pi, n))[:, None], "runs share a shape"),
    ],
    ids=["levels", "shape"],
)
def test_patterns_of_runs_are_no_noise_where_the_rest_is_white(
    swum: tuple[Problem, Fit], pattern: Callable[[float, int], FloatArray], told: str
) -> None:
    """Every run is off by a constant of its own, or all are off alike, under white noise: that noise is left."""
    problem, one = swum
    rng = np.random.default_rng(9)
    draws = [lambda n, sign=sign: SIGMA * (rng.standard_normal((n, 3)) + pattern(sign, n)) for sign in (1.0, -1.0)]
    noise, words = _noise_found(_with_noise(problem, draws), one)
    assert told in words
    assert isinstance(noise, Autoregressive)
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.1)


def test_a_wander_is_noise_though_it_gives_runs_levels(swum: tuple[Problem, Fit]) -> None:
    problem, one = swum
    for seed in (9, 10, 11):
        rng = np.random.default_rng(seed)
        noise, words = _noise_found(_with_noise(problem, [lambda n: _drifting(rng, n)] * 2), one)  # noqa: B023
        assert "that it does not explain" not in words
        assert isinstance(noise, GaussMarkov)


def test_a_wander_as_slow_as_the_runs_is_said_to_be_doubtful(swum: tuple[Problem, Fit]) -> None:
    """Runs that go off steadily, and runs whose camera wanders for half a second."""
    problem, one = swum
    rng = np.random.default_rng(8)
    steadily = [
        lambda n, off=off: SIGMA * (rng.standard_normal((n, 3)) + np.linspace(-off, off, n)[:, None])
        for off in (1.5, -1.5)
    ]
    slow, quick = (
        _noise_found(_with_noise(problem, draws), one)[1] for draws in (steadily, [lambda n: _drifting(rng, n)] * 2)
    )
    assert "too short to tell so slow a drift" in slow
    assert "a drift of" in quick
    assert "too short" not in quick
