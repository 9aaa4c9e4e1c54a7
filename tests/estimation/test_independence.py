"""Independence of residual and input: calibrated under the null, whatever the noise; a hidden effect fails it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hidden_cases import STRONG
from residual_draws import Draws, draws
from scipy import linalg, signal, stats
from synthetic_swimming import SIGMA, TRUTH, problem, swimming

from mjfish.arrays import FloatArray, readonly
from mjfish.effects import find
from mjfish.estimation import fit
from mjfish.estimation.residual import fitted
from mjfish.estimation.residual_tests import (
    LAG,
    CrossCorrelation,
    absorbed,
    background,
    coloured,
    examine,
    independence,
    lagged,
    residual_tests,
)
from mjfish.fish import Fish
from mjfish.noise import Autoregressive
from mjfish.serialise import plain

#: Share of a strong effect, where a third leaves little behind the coefficients in two short runs.
LARGER = {"roll_loss": 0.7, "added_mass_amplitude": 0.7}


@pytest.fixture(scope="module")
def null(pike: Fish) -> Draws:
    return draws(pike)


def _p(tests: Sequence[CrossCorrelation], *, pooled: bool) -> FloatArray:
    return np.array([t.p_value for t in tests if (t.trial == "all") == pooled])


@pytest.mark.parametrize("phi", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
@pytest.mark.parametrize("count", [16, pytest.param(200, marks=pytest.mark.slow)])
def test_p_values_are_uniform_and_bands_hold_under_the_null(null: Draws, pike: Fish, phi: float, count: int) -> None:
    """Fits of white and of drifting noise, 18 + 6 tests each. Catches R_e left out, the notch, the fit left out."""
    rng = np.random.default_rng(21)
    drawn = [independence(null.residuals(rng, phi), pike.cpg, null.absorbed) for _ in range(count)]
    for pooled in (False, True):
        p = np.concatenate([_p(tests, pooled=pooled) for tests in drawn])
        assert stats.kstest(p, "uniform").pvalue > 1e-3
        assert np.mean(p < 0.05) == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / len(p)))
    outside = np.mean([np.abs(t.value) > t.band for tests in drawn for t in tests])
    assert outside == pytest.approx(0.01, abs=0.006)


def test_a_residual_taken_for_one_that_was_not_fitted_seems_too_good(pike: Fish) -> None:
    """One short trial: nine of some 27 directions are the fit's. Catches `clear` doing nothing, or too much."""
    short = draws(pike, ("v1",), 3.0)
    rng = np.random.default_rng(22)
    residuals = [short.residuals(rng, 0.0) for _ in range(40)]
    blind = np.concatenate([_p(independence(r, pike.cpg), pooled=True) for r in residuals])
    aware = np.concatenate([_p(independence(r, pike.cpg, short.absorbed), pooled=True) for r in residuals])
    assert stats.kstest(aware, "uniform").pvalue > 1e-3
    assert stats.kstest(blind, "uniform").pvalue < 1e-4


@pytest.mark.parametrize("effect", sorted(STRONG))
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


def test_drifting_noise_is_coloured_and_not_dependent(null: Draws, pike: Fish) -> None:
    """The two questions are told apart."""
    found = examine(null.residuals(np.random.default_rng(23), 0.8), null.problem.noise, pike.cpg, null.absorbed)
    assert found.status == "coloured"
    assert found.p_independent > 0.01


def test_a_line_of_the_input_does_not_pass_for_noise(null: Draws, pike: Fish) -> None:
    """As strong as the noise, in one trial and channel: that test fails, the tests of another channel do not."""
    time = null.problem.trials[1].time
    line = np.zeros((len(time), 3))
    line[:, 1] = 1.4 * SIGMA[1] * np.sin(26.0 * time)
    residuals = null.residuals(np.random.default_rng(24), 0.0, {1: line})
    tests = independence(residuals, pike.cpg, null.absorbed)
    hit = {(t.trial, t.channel, t.input): t for t in tests}
    assert hit["v5", "sway", "beat"].p_value < 1e-12
    assert hit["all", "sway", "beat"].p_value < 1e-12
    assert np.max(np.abs(hit["v5", "sway", "beat"].value) / hit["v5", "sway", "beat"].band) > 4.0
    assert min(t.p_value for t in tests if t.channel == "surge") > 1e-3


def test_an_input_is_the_command_of_the_last_joint_and_lags_are_those_of_the_residual(null: Draws, pike: Fish) -> None:
    """Catches lags of the wrong sign, samples that do not count."""
    residual = null.residuals(np.random.default_rng(25), 0.0)[0]
    found = lagged(pike.cpg, residual, "beat")
    time, values = residual.trial.time, found.basis @ found.loading
    now, behind = int(np.argmin(np.abs(LAG))), int(np.argmin(np.abs(LAG - 0.1)))
    np.testing.assert_allclose(values[5:, behind], values[:-5, now], atol=0.05 * np.abs(values).max())
    beat = np.abs(np.fft.rfft(values[100:, now] * np.hanning(len(time) - 100)))
    assert np.fft.rfftfreq(len(time) - 100, 0.02)[np.argmax(beat)] == pytest.approx(18.0 / 2.0 / np.pi, abs=0.2)
    assert found.main < found.basis.shape[1]
    residual.counted[50:60] = False
    assert not np.any(lagged(pike.cpg, residual, "beat").basis[50:60])


def test_the_input_of_a_long_run_is_taken_block_by_block(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    posed = problem(swimming(pike, ("v1",)))
    residual = fitted(posed, posed.start())[0]
    whole = lagged(pike.cpg, residual, "double_beat")
    monkeypatch.setattr("mjfish.estimation.residual_tests._SAMPLES", 40)
    parts = lagged(pike.cpg, residual, "double_beat")
    np.testing.assert_allclose(parts.basis @ parts.loading, whole.basis @ whole.loading, atol=1e-12)
    np.testing.assert_allclose(parts.power, whole.power)


def test_cleared_columns_see_of_the_noise_what_the_residual_shows(pike: Fish) -> None:
    """u'(I - J (J'WJ)^+ J'W) v = u~'v, dense. Catches a transpose, a filter run the wrong way or over a gap.

    Autoregressive weights; in one trial rows are missing, twice, and one stretch is shorter than the filter.
    """
    first, second = swimming(pike, ("v1", "v3"), duration=1.06).trials
    there = np.ones(54, dtype=np.bool_)
    there[[20, 22, 23]] = False
    second = replace(second, time=second.time[there], velocity=readonly(second.velocity[there]))
    dataset = replace(swimming(pike, ("v1",), duration=1.0), trials=(first, second))
    noise = Autoregressive(readonly(SIGMA), readonly([[0.5, 0.2], [0.3, 0.1], [-0.4, 0.0]]))
    posed = problem(dataset, noise=noise)
    one = fit(posed, posed.start(TRUTH), evaluations=1)
    taken = absorbed(posed, one)
    rng = np.random.default_rng(26)
    noises = [rng.standard_normal((len(trial.time), 3)) for trial in dataset.trials]
    columns = [rng.standard_normal((len(trial.time), 3, 4)) for trial in dataset.trials]
    slopes = posed.slopes(one.x)
    rows = posed.velocity_rows(slopes).dense()[:, ~one.at_bound]
    white = posed.whiten([v[:, :, None] for v in noises])[:, 0]
    step = np.linalg.lstsq(rows, white, rcond=None)[0]
    left = [v - j[:, :, ~one.at_bound] @ step for v, j in zip(noises, slopes.velocity, strict=True)]
    direct = sum(np.einsum("ncd,nc->d", u, e) for u, e in zip(columns, left, strict=True))
    common = sum(taken.shared_share(r, u) for r, u in enumerate(columns))
    cleared = [taken.own_cleared(r, u) - taken.weighed(r, len(u)) @ common for r, u in enumerate(columns)]
    through = sum(np.einsum("ncd,nc->d", u, v) for u, v in zip(cleared, noises, strict=True))
    np.testing.assert_allclose(through, direct, rtol=1e-7)


def test_the_variance_is_the_sum_over_both_autocovariances() -> None:
    """U' S u by filtering = dense = N sum_k R_e(k) R_u(k) ([Ljung1999], eq. (16.70))."""
    phi, n = 0.8, 400
    noise = Autoregressive(readonly([1.0, 1.0, 1.0]), readonly(np.full((3, 1), phi)))
    u = np.sin(0.36 * np.arange(n))
    shaped = coloured(noise, 0, u[:, None])[:, 0]
    covariance = phi ** np.arange(n) / (1.0 - phi**2)
    dense = u @ linalg.toeplitz(covariance) @ u
    input_products = np.array([u[k:] @ u[: n - k] for k in range(n)])
    assert shaped @ shaped == pytest.approx(dense, rel=1e-9)
    assert covariance[0] * input_products[0] + 2.0 * covariance[1:] @ input_products[1:] == pytest.approx(dense)
    assert dense / (covariance[0] * input_products[0]) == pytest.approx(2.53, abs=0.1)  # spectrum over variance


def test_the_background_is_the_noise_without_the_line_and_without_a_notch() -> None:
    """A strong line at the frequency of the basis; twelve of 300 directions taken. Catches either half of the step."""
    rng = np.random.default_rng(27)
    time = np.arange(300)
    waves = np.stack([f(0.02 * k * time) for k in range(1, 7) for f in (np.cos, np.sin)], axis=1)
    basis = linalg.orth(waves)
    phi = 0.7
    white = rng.standard_normal((500 * 12, 3))
    series = signal.lfilter([1.0], [1.0, -phi], white, axis=0).reshape(12, 500, 3)[:, 200:]
    found = background([one + 5.0 * waves[:, :1] for one in series], [basis] * 12)
    gain = np.array([1.0 / (1.0 - row.sum()) for row in found.phi]) * found.sigma
    np.testing.assert_allclose(gain, 1.0 / (1.0 - phi), rtol=0.15)
    np.testing.assert_allclose(found.sigma, 1.0, rtol=0.05)


def test_a_trial_that_diverged_is_left_out_and_named(null: Draws, pike: Fish) -> None:
    residuals = null.residuals(np.random.default_rng(28), 0.0)
    gone = [replace(residual, predicted=np.full_like(residual.predicted, np.nan)) for residual in residuals]
    found = examine([gone[0], *residuals[1:]], null.problem.noise, pike.cpg)
    assert found.skipped == ("v1",)
    assert {t.trial for t in found.whiteness} == {"v5", "v3-t2", "all"}
    nothing = examine(gone, null.problem.noise, pike.cpg)
    assert (nothing.status, nothing.whiteness, nothing.skipped) == ("untested", (), ("v1", "v5", "v3-t2"))


def test_a_posed_fit_is_examined_at_its_estimates(pike: Fish) -> None:
    posed = problem(swimming(pike, ("v1",), duration=3.0))
    one = fit(posed)
    found, by_hand = residual_tests(posed, one), examine(
        fitted(posed, one.x), posed.noise, pike.cpg, absorbed(posed, one)
    )  # fmt: skip
    assert found.p_independent == by_hand.p_independent
    assert plain(found)["whiteness"][0]["trial"] == "v1"
