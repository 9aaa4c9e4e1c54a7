"""Waves weighed by how well they are seen: what noise of differentiated positions leaves of a slow misfit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.diagnosis.refit import refined, refit_with
from mjfish.diagnosis.select import Goodness
from mjfish.diagnosis.table import THRESHOLDS, Row
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.noise import DifferentiationNoise
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.04])
ROUGH = DifferentiationNoise(readonly(SIGMA), window=9, degree=4, rounding=0.05, doubt=0.15)
MODES = ["v1", "v5", "v3-t1"]
LAG = find("servo_lag")


def _rough(rng: np.random.Generator, samples: int) -> FloatArray:
    places = rng.standard_normal((samples + 36, 3))
    slopes = signal.savgol_filter(places, 9, 4, deriv=1, axis=0)[18:-18]
    white = 0.05 * rng.standard_normal((samples, 3))
    return SIGMA * (slopes / np.linalg.norm(signal.savgol_coeffs(9, 4, deriv=1)) + white) / np.hypot(1.0, 0.05)


def _runs(pike: Fish, noise: Noise, slow: float, seed: int, lag: float = 0.0) -> tuple[Trial, ...]:
    """Return runs whose surge is off by a slow curve of each run [sigma]."""
    rng = np.random.default_rng(seed)
    values = {"servo_lag.time_constant": lag} if lag else {}
    pool = generate(pike, MODES, values=values, effects=[LAG] if lag else [], duration=6.0, seed=1, held_out=[])
    found = []
    for trial in pool.trials:
        n = len(trial.time)
        rough = _rough(rng, n) if isinstance(noise, DifferentiationNoise) else SIGMA * rng.standard_normal((n, 3))
        wave = np.cos(np.pi * np.outer(np.arange(n) / n, [1.0, 2.0])) @ rng.standard_normal(2)
        off = slow * SIGMA * wave[:, None] * [1.0, 0.0, 0.0]
        found.append(replace(trial, velocity=readonly(trial.velocity + rough + off)))
    return tuple(found)


def _evidence(pike: Fish, noise: Noise, slow: float, seed: int) -> Evidence:
    problem = Problem(Model(pike), _runs(pike, noise, slow, seed), noise)
    return gather(problem, fit(problem), [LAG])


def test_they_are_the_omnibus_test_under_white_noise(pike: Fish) -> None:
    white = Noise.white(SIGMA)
    for slow in (0.0, 0.5):
        evidence = _evidence(pike, white, slow, 0)
        test = evidence.weighed()
        assert abs(stats.norm.isf(test.p) - stats.norm.isf(evidence.omnibus_p())) < 1.0
        assert test.beyond < evidence.omnibus_excess() + 25.0


@pytest.mark.slow
def test_their_p_value_is_none_of_a_misfit_under_noise(pike: Fish) -> None:
    found = [_evidence(pike, ROUGH, 0.0, seed).weighed().p for seed in range(8)]
    assert min(found) > 0.005
    assert max(found) > 0.3


def test_they_see_a_slow_misfit_that_drowns_in_all_waves(pike: Fish) -> None:
    """Of a fiftieth of the noise's rms; another wave in each run."""
    drowned, seen = [], []
    for seed in (3, 4, 5):
        evidence = _evidence(pike, ROUGH, 0.026, seed)
        test = evidence.weighed()
        drowned.append(stats.norm.isf(evidence.omnibus_p()))
        seen.append(stats.norm.isf(test.p))
        assert 0.0 < test.beyond < evidence.omnibus_excess() + 30.0
    assert np.mean(seen) > np.mean(drowned) + 0.7


@pytest.mark.parametrize(("slow", "clean"), [(0.0, True), (0.023, False)])
def test_a_cause_that_leaves_a_slow_misfit_is_not_clean(pike: Fish, slow: float, clean: bool) -> None:
    """No other test sees it."""
    problem = Problem(Model(pike), _runs(pike, ROUGH, slow, 3, lag=0.0008), ROUGH)
    refit = refined(refit_with(gather(problem, fit(problem), [LAG]), LAG), np.inf)
    row = Goodness([find("time_offset")]).of(refit, Row.of(refit.names, refit, 0.0, 1.0))
    assert row.clean() is clean
    assert min(p for test, p in row.tests.items() if test != "weighed waves") >= THRESHOLDS.goodness
