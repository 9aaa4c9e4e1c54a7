"""The probability of a verdict is how often linear models with drawn noise give one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mjfish.design.information import NO_GAIN, Gain, Information, Separation, column, excluded, verdict_probability
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.numerics.arrays import FloatArray

DRAWS = 1500


def _information(k: FloatArray, l: FloatArray, d: FloatArray, own: str = "") -> Information:  # noqa: E741
    """Return sums of both; `own`: the last column of each is the run's own."""
    names = []
    for rival, columns in (("k", k), ("l", l)):
        count = columns.shape[1] - bool(own)
        names += [column(rival, f"p{i}") for i in range(count)] + ([column(rival, own)] if own else [])
    return Information.of(tuple(names), np.hstack([k, l]), d)


def _sse(columns: FloatArray, y: FloatArray) -> tuple[float, FloatArray]:
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.sum((y - columns @ x) ** 2)), x


@pytest.mark.parametrize(
    ("own_k", "own_l", "size", "share", "ahead"), [(1, 1, 0.8, (0.2, 0.9), 0.1), (1, 3, 0.3, (0.0, 0.05), 0.0)]
)
def test_a_verdict_comes_as_often_as_foretold_from_data_that_give_none(
    own_k: int, own_l: int, size: float, share: tuple[float, float], ahead: float
) -> None:
    """Two linear models, sizes drawn wide, runs old and new, noise drawn: only cases undecided by the old run count.

    A probability that forgets the margin, or that takes an undecided case for a fresh one, is too high here; of weak
    sizes, one that takes the noise of the fits for a difference is 0.06 where 0.01 is true.
    """
    rng = np.random.default_rng(11)
    n = 30
    shared, own = rng.standard_normal((2 * n, 3)), rng.standard_normal((2 * n, own_k))
    like = own[:, np.arange(own_l) % own_k]
    blur = rng.standard_normal((2 * n, own_l))
    other = np.vstack([0.97 * like[:n] + 0.24 * blur[:n], 0.8 * like[n:] + 0.6 * blur[n:]])
    k, l = np.hstack([shared, own]), np.hstack([shared, other])  # noqa: E741
    foretold, came = [], []
    for _ in range(DRAWS):
        y = k @ np.concatenate([rng.standard_normal(3), rng.normal(0.0, size, own_k)]) + rng.standard_normal(2 * n)
        (sse_k, x_k), (sse_l, x_l) = _sse(k[:n], y[:n]), _sse(l[:n], y[:n])
        d = k @ x_k - l @ x_l
        margin = sse_l - sse_k
        found = Separation(_information(k[:n], l[:n], d[:n]), (_information(k[n:], l[n:], d[n:]),), ("k", "l"), margin)
        if excluded(margin) or excluded(-margin):
            continue
        foretold.append(verdict_probability(margin, found.gain("k", 0)))
        came.append(excluded(_sse(l, y)[0] - _sse(k, y)[0]))
    assert len(came) > 400
    assert share[0] < np.mean(came) < share[1]
    assert np.mean(foretold) == pytest.approx(np.mean(came), abs=3.0 * np.std(came) / np.sqrt(len(came)))
    sure = np.array(foretold) > np.median(foretold)
    assert np.mean(np.array(came)[sure]) > np.mean(np.array(came)[~sure]) + ahead


def test_the_gain_of_a_run_by_whole_matrices() -> None:
    """The equations of `mjfish.design.information` as they are written; a run's own column is free."""
    rng = np.random.default_rng(2)
    n = 12
    old_k, old_l, old_d = rng.standard_normal((20, 3)), rng.standard_normal((20, 2)), rng.standard_normal(20)
    new_k, new_l, d = rng.standard_normal((n, 4)), rng.standard_normal((n, 3)), rng.standard_normal(n)
    found = Separation(
        _information(old_k, old_l, old_d), (_information(new_k, new_l, d, "run:own"),), ("k", "l"), 0.0
    ).gain("k", 0)
    c_k, c_l = (np.linalg.inv(j.T @ j) for j in (old_k, old_l))
    t_k, t_l = (np.eye(n) + j[:, :-1] @ c @ j[:, :-1].T for j, c in ((new_k, c_k), (new_l, c_l)))
    p_k, p_l = (
        np.linalg.inv(t) - _along(np.linalg.inv(t) @ j[:, -1], j[:, -1]) for t, j in ((t_k, new_k), (t_l, new_l))
    )
    shift = new_k[:, :-1] @ c_k @ old_k.T - new_l[:, :-1] @ c_l @ old_l.T
    raw = d @ p_l @ d
    seen = raw - np.trace(p_l @ shift @ shift.T)
    assert 0.3 * raw < seen < 0.9 * raw
    turned = (p_l - p_k) @ t_k
    assert found.mean == pytest.approx(seen + np.trace(turned))
    variance = 4.0 * seen / raw * (d @ p_l @ t_k @ p_l @ d) + 2.0 * np.trace(turned @ turned)
    assert found.spread == pytest.approx(np.sqrt(variance))


def _along(weighed: FloatArray, own: FloatArray) -> FloatArray:
    return np.outer(weighed, weighed) / (own @ weighed)


def test_probability_for_data_not_yet_taken_is_that_of_nearly_parallel_signatures() -> None:
    """Phi(sqrt(lambda_k (1 - rho) / 2)) with lambda = lambda_k (1 - rho^2)."""
    rho, strength = 0.98, 800.0
    lam = strength * (1.0 - rho**2)
    likelier = np.log(10.0) / np.sqrt(lam)  # what ten times the likelihood costs
    limit = stats.norm.cdf(np.sqrt(strength * (1.0 - rho) / 2.0) - likelier)
    assert verdict_probability(0.0, Gain(lam, 2.0 * np.sqrt(lam))) == pytest.approx(limit, abs=1e-3)
    assert verdict_probability(0.0, NO_GAIN) == 0.0


def test_ten_times_the_likelihood_is_further_than_noise_leads() -> None:
    """Were l the truth, 5 % of margins are beyond 2 z sqrt(lambda) - lambda, whatever lambda."""
    distance = np.geomspace(1e-3, 1e3, 200)
    assert np.max(2.0 * stats.norm.ppf(0.95) * np.sqrt(distance) - distance) < THRESHOLDS.close
    assert excluded(THRESHOLDS.close)
    assert not excluded(0.99 * THRESHOLDS.close)


def test_without_a_run_the_verdict_is_the_one_at_hand() -> None:
    """Undecided: none; decided: right as often as the odds of the margin say; and a run that adds much decides."""

    def pair(margin: float) -> Separation:
        return Separation(Information((), np.zeros((0, 0)), np.zeros(0), 0.0), (), ("k", "l"), margin)

    assert pair(4.5).probability() == pytest.approx(0.0, abs=1e-9)
    assert pair(6.0).probability() == pytest.approx(1.0 / (1.0 + np.exp(-3.0)))
    assert verdict_probability(0.0, Gain(40.0, 13.0)) > 0.99
