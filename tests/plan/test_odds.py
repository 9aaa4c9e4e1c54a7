"""The chance of a verdict is how often linear models with drawn noise give one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mjfish.arrays import FloatArray
from mjfish.diagnose.select import CLOSE
from mjfish.plan.odds import chance, drops, told
from mjfish.plan.separation import Distances, Sums

DRAWS = 600


def _sums(columns: FloatArray, d: FloatArray) -> Sums:
    names = tuple(f"p{i}" for i in range(columns.shape[1]))
    return Sums(names, columns.T @ columns, columns.T @ d, float(d @ d))


def _sse(columns: FloatArray, y: FloatArray) -> tuple[float, FloatArray]:
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.sum((y - columns @ x) ** 2)), x


def test_a_verdict_comes_as_often_as_foretold_from_data_that_give_none() -> None:
    """Two linear models, sizes drawn wide, runs old and new, noise drawn: only cases undecided by the old run count.

    A chance that forgets the margin at hand, or that takes an undecided case for a fresh one, is too high here.
    """
    rng = np.random.default_rng(11)
    n = 30
    shared, own = rng.standard_normal((2 * n, 2)), rng.standard_normal((2 * n, 1))
    other = np.vstack([0.97 * own[:n] + 0.24 * rng.standard_normal((n, 1)), 0.8 * own[n:] + 0.6 * shared[n:, :1]])
    k, l = np.hstack([shared, own]), np.hstack([shared, other])  # noqa: E741
    foretold, came = [], []
    for _ in range(DRAWS):
        y = k @ np.concatenate([rng.standard_normal(2), rng.normal(0.0, 0.8, 1)]) + rng.standard_normal(2 * n)
        (sse_k, x_k), (sse_l, x_l) = _sse(k[:n], y[:n]), _sse(l[:n], y[:n])
        d = k @ x_k - l @ x_l
        found = Distances(
            old={("k", "l"): _sums(l[:n], d[:n]), ("l", "k"): _sums(k[:n], -d[:n])},
            new={("k", "l"): (_sums(l[n:], d[n:]),), ("l", "k"): (_sums(k[n:], -d[n:]),)},
            sse={"k": sse_k, "l": sse_l},
        )
        margin = sse_l - sse_k
        if drops(margin) or drops(-margin):
            continue
        foretold.append(told(margin, found.gain("k", "l", 0)))
        came.append(drops(_sse(l, y)[0] - _sse(k, y)[0]))
    assert len(came) > 200
    assert 0.2 < np.mean(came) < 0.9
    assert np.mean(foretold) == pytest.approx(np.mean(came), abs=3.0 * 0.5 / np.sqrt(len(came)))
    sure = np.array(foretold) > np.median(foretold)
    assert np.mean(np.array(came)[sure]) > np.mean(np.array(came)[~sure]) + 0.1


def test_the_gain_of_a_run_is_what_a_refit_cannot_follow() -> None:
    """d'(1 + J_m C J_m')^-1 d, C = (J'J)^-1."""
    rng = np.random.default_rng(2)
    old, new, d = rng.standard_normal((20, 3)), rng.standard_normal((9, 3)), rng.standard_normal(9)
    found = Distances(
        {("k", "l"): _sums(old, rng.standard_normal(20))}, {("k", "l"): (_sums(new, d),)}, {"k": 0.0, "l": 0.0}
    )
    expected = d @ np.linalg.solve(np.eye(9) + new @ np.linalg.inv(old.T @ old) @ new.T, d)
    assert found.gain("k", "l", 0) == pytest.approx(float(expected))
    assert found.gain("k", "l") == 0.0


def test_chance_of_data_not_yet_taken_is_that_of_nearly_parallel_signatures() -> None:
    """Phi(sqrt(lambda_k (1 - rho) / 2)) with lambda = lambda_k (1 - rho^2)."""
    rho, strength = 0.98, 800.0
    lam = strength * (1.0 - rho**2)
    likelier = np.log(10.0) / np.sqrt(lam)  # what ten times the likelihood costs
    limit = stats.norm.cdf(np.sqrt(strength * (1.0 - rho) / 2.0) - likelier)
    assert told(0.0, lam) == pytest.approx(limit, abs=1e-3)
    assert told(0.0, 1e-9) == 0.0


def test_ten_times_the_likelihood_is_further_than_noise_leads() -> None:
    """Were l the truth, 5 % of margins are beyond 2 z sqrt(lambda) - lambda, whatever lambda."""
    distance = np.geomspace(1e-3, 1e3, 200)
    assert np.max(2.0 * stats.norm.ppf(0.95) * np.sqrt(distance) - distance) < CLOSE
    assert drops(CLOSE)
    assert not drops(0.99 * CLOSE)


def test_without_a_run_the_verdict_is_the_one_at_hand() -> None:
    """Undecided: no chance at all; decided: right as often as the odds of the margin say."""
    assert chance(4.5, (0.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    assert chance(6.0, (0.0, 0.0)) == pytest.approx(1.0 / (1.0 + np.exp(-3.0)))
    assert chance(0.0, (40.0, 40.0)) > 0.99
