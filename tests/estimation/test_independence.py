"""Independence of residual and input: calibrated under the null, whatever the noise; a hidden effect fails it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from changed_fit import having
from hidden_cases import STRONG
from residual_draws import Draws, at, draws
from scipy import stats
from synthetic_swimming import SIGMA, TRUTH, problem, swimming

from mjfish.effects import find
from mjfish.estimation import Fit, Problem, fit
from mjfish.estimation.identification import pose
from mjfish.estimation.residual_tests import LAG, CrossCorrelation, independence, lagged, residual_tests, series_of
from mjfish.estimation.sensor_noise import with_sensor_noise
from mjfish.estimation.serial_correlation import serial_blocks
from mjfish.files.plain_data import plain
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.simulation.synthetic import generate

#: Hidden effects that leave the least of their input in the residual; the others are for the slow tests.
FAINT = ("servo_backlash", "clock_rate", "trim_moment", "reynolds_drag", "munk_moment")
#: Share of a strong effect, where a third leaves little behind the coefficients in two short runs.
LARGER = {"roll_loss": 0.7, "added_mass_amplitude": 0.7}


@pytest.fixture(scope="module")
def null(pike: Fish) -> Draws:
    return draws(pike)


def _tests(drawn: Draws, one: Fit) -> tuple[CrossCorrelation, ...]:
    return independence(drawn.problem, one, series_of(drawn.problem, serial_blocks(drawn.problem, one.residual)))


def _p(tests: Sequence[CrossCorrelation], *, pooled: bool) -> FloatArray:
    return np.array([t.p_value for t in tests if (t.trial == "all") == pooled])


@pytest.mark.parametrize("phi", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
@pytest.mark.parametrize("count", [16, pytest.param(200, marks=pytest.mark.slow)])
def test_p_values_are_uniform_and_bands_hold_under_the_null(null: Draws, phi: float, count: int) -> None:
    """Fits of white and of drifting noise, 18 + 6 tests each. Catches R_e left out, the notch, the fit left out."""
    rng = np.random.default_rng(21)
    drawn = [_tests(null, null.drawn(rng, phi)) for _ in range(count)]
    for pooled in (False, True):
        p = np.concatenate([_p(tests, pooled=pooled) for tests in drawn])
        assert stats.kstest(p, "uniform").pvalue > 1e-3
        assert np.mean(p < 0.05) == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / len(p)))
    outside = np.mean([np.abs(t.value) > t.band for tests in drawn for t in tests])
    assert outside == pytest.approx(0.01, abs=0.006)


def test_a_residual_taken_for_one_that_was_not_fitted_seems_too_good(pike: Fish) -> None:
    """One short trial: nine of some 27 directions are the fit's. Catches what it took left in, or taken twice."""
    short, p = draws(pike, ("v1",), 3.0), {True: list[FloatArray](), False: list[FloatArray]()}
    rng = np.random.default_rng(22)
    for _ in range(40):
        one = short.drawn(rng, 0.0)
        unfitted = having(one, jacobian=one.jacobian.scaled(columns=np.zeros(one.jacobian.shape[1])))
        for aware, given in ((True, one), (False, unfitted)):
            p[aware].append(_p(_tests(short, given), pooled=True))
    assert stats.kstest(np.concatenate(p[True]), "uniform").pvalue > 1e-3
    assert stats.kstest(np.concatenate(p[False]), "uniform").pvalue < 1e-4


@pytest.mark.parametrize(
    "effect", [*FAINT, *(pytest.param(name, marks=pytest.mark.slow) for name in sorted(set(STRONG) - set(FAINT)))]
)
def test_a_hidden_effect_fails_after_the_refit(pike: Fish, effect: str) -> None:
    """A share of a strong one. The coefficients have adapted; the input is still seen in the residual."""
    rng = np.random.default_rng(5)
    share = LARGER.get(effect, 0.3)
    hidden = {f"{effect}.{short}": share * value for short, value in STRONG[effect](rng).items()}
    dataset = swimming(pike, ("v1", "v5"), duration=5.0, values=TRUTH | hidden, effects=[find(effect)])
    posed = problem(dataset)
    found = residual_tests(posed, fit(posed))
    assert found.status == "dependent"
    assert found.p_independent < 1e-4
    assert found.p_white < 1e-3


def test_data_of_the_model_itself_pass(pike: Fish) -> None:
    """A fit of its own for each of four draws: p values as they come, none tiny."""
    found = []
    for seed in range(4):
        posed = problem(swimming(pike, ("v1", "v5"), duration=4.0, seed=seed))
        found.append(residual_tests(posed, fit(posed)))
    assert all(one.p_independent > 0.003 and one.p_white > 0.003 for one in found)
    assert max(one.p_independent for one in found) > 0.1


def test_drifting_noise_is_coloured_and_not_dependent(null: Draws) -> None:
    """The two questions are told apart."""
    found = residual_tests(null.problem, null.drawn(np.random.default_rng(23), 0.8))
    assert found.status == "coloured"
    assert found.p_independent > 0.01


def test_a_line_of_the_input_does_not_pass_for_noise(null: Draws) -> None:
    """As strong as the noise, in one trial and channel: that test fails, the tests of another channel do not."""
    time = null.problem.trials[1].time
    line = np.zeros((len(time), 3))
    line[:, 1] = 1.4 * SIGMA[1] * np.sin(26.0 * time)
    tests = _tests(null, null.drawn(np.random.default_rng(24), 0.0, {1: line}))
    hit = {(t.trial, t.channel, t.input): t for t in tests}
    assert hit["v5", "sway", "beat"].p_value < 1e-12
    assert hit["all", "sway", "beat"].p_value < 1e-12
    assert np.max(np.abs(hit["v5", "sway", "beat"].value) / hit["v5", "sway", "beat"].band) > 4.0
    assert min(t.p_value for t in tests if t.channel == "surge") > 1e-3


def test_an_input_is_the_command_of_the_last_joint_and_lags_are_those_of_the_residual(null: Draws) -> None:
    """Catches lags of the wrong sign."""
    found = lagged(null.problem, 0, "", "beat")
    time = null.problem.trials[0].time[null.problem.mask(0)]
    values = found.basis @ found.loading
    now, behind = int(np.argmin(np.abs(LAG))), int(np.argmin(np.abs(LAG - 0.1)))
    np.testing.assert_allclose(values[5:, behind], values[:-5, now], atol=0.05 * np.abs(values).max())
    beat = np.abs(np.fft.rfft(values[100:, now] * np.hanning(len(time) - 100)))
    assert np.fft.rfftfreq(len(time) - 100, 0.02)[np.argmax(beat)] == pytest.approx(18.0 / 2.0 / np.pi, abs=0.2)
    assert found.main < found.basis.shape[1]


def test_the_input_of_a_long_run_is_taken_block_by_block(null: Draws, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = lagged(null.problem, 0, "", "double_beat")
    monkeypatch.setattr("mjfish.estimation.residual_tests._SAMPLES", 40)
    parts = lagged(null.problem, 0, "", "double_beat")
    np.testing.assert_allclose(parts.basis @ parts.loading, whole.basis @ whole.loading, atol=1e-12)


def test_over_all_trials_the_variance_is_that_of_the_sum(null: Draws) -> None:
    """Against draws of white noise. Catches covariances between trials, by what they share, left out or doubled."""
    rng = np.random.default_rng(26)
    drawn = [_tests(null, null.drawn(rng, 0.0)) for _ in range(24)]
    bands = [[one.band for one in tests if one.trial == "all"] for tests in drawn]
    values = [[one.value for one in tests if one.trial == "all"] for tests in drawn]
    share = np.std(values, axis=0, ddof=1) / (np.mean(bands, axis=0) / stats.norm.isf(0.005))
    assert np.mean(share) == pytest.approx(1.0, abs=0.1)


def _filmed(pike: Fish, **hidden: float) -> tuple[Problem, Fit]:
    effects = [find(name.partition(".")[0]) for name in hidden]
    dataset = generate(
        pike, ("v1", "v5"), duration=5.0, values=TRUTH | hidden, effects=effects, noise=(0.001, 0.001, 0.01),
        observe="pose", seed=3,
    )  # fmt: skip
    posed = pose(dataset)
    posed = with_sensor_noise(posed, posed.start(TRUTH))
    return posed, fit(posed, posed.start(TRUTH))


def test_a_film_is_tested_in_its_own_numbers(pike: Fish) -> None:
    """Places and headings that were seen, no velocity: silent where nothing is hidden, not where something is."""
    channels = {"head x", "head y", "heading heading"}
    quiet = residual_tests(*_filmed(pike))
    assert {one.channel for one in quiet.independence} == {one.channel for one in quiet.whiteness}
    assert len({one.channel for one in quiet.whiteness}) == len(channels)
    assert quiet.status == "passed"
    hidden = residual_tests(*_filmed(pike, **{"servo_lag.time_constant": 0.02}))
    assert hidden.status == "dependent"
    assert hidden.p_independent < 1e-4


def test_channels_that_measured_joints_couple_are_tested_at_their_level(pike: Fish) -> None:
    """Films whose joints were measured with an error: the whitening couples the channels. Catches rows left out."""
    dataset = generate(
        pike, ("v1", "v5"), duration=8.0, values=TRUTH, noise=(0.001, 0.001, 0.01), observe="pose", joints="measured",
        joint_noise=0.02, seed=4,
    )  # fmt: skip
    posed = pose(dataset)
    posed = with_sensor_noise(posed, posed.start(TRUTH))
    assert posed.joint_errors is not None
    drawn, rng = Draws(posed, at(posed, posed.start(TRUTH))), np.random.default_rng(29)
    basis = drawn.fit.jacobian.factors.basis
    tests = [
        _tests(drawn, having(drawn.fit, residual=basis.off(rng.standard_normal(len(drawn.fit.residual)))))
        for _ in range(30)
    ]
    for channel in {one.channel for one in tests[0]}:
        p = np.array([one.p_value for each in tests for one in each if one.channel == channel])
        assert np.mean(p < 0.05) < 0.12, channel
        assert stats.kstest(p, "uniform").pvalue > 1e-3, channel


def test_a_fit_that_diverged_is_not_tested(null: Draws) -> None:
    found = residual_tests(null.problem, replace(null.fit, status="diverged"))
    assert (found.status, found.whiteness) == ("untested", ())
    assert plain(found)["independence"] == []
