"""Whether the motion was smoothed is found from its noise and tried on predictions; what else is wrong is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import interpolate, signal

from mjfish.data import Trial
from mjfish.data.trial import Differentiator
from mjfish.diagnosis.screening import screen
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import find
from mjfish.estimation import Noise, Problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.04])
LAG = find("servo_lag")


def _differentiated(trial: Trial, rng: np.random.Generator, *, motion: bool) -> Trial:
    """Return a trial with the noise of central differences of positions, its motion smoothed by them or not."""
    path = interpolate.CubicSpline(trial.time, trial.velocity).antiderivative()(trial.time)
    noise = np.gradient(rng.standard_normal((len(path) + 2, 3)), axis=0)[1:-1]  # its ends are noisier
    true = np.gradient(path, trial.step, axis=0) if motion else trial.velocity
    return replace(trial, velocity=readonly(true + SIGMA * noise / noise.std()))


def _problem(lag: float, *, motion: bool) -> Problem:
    fish, rng = load_fish("pike"), np.random.default_rng(11)
    effects, values = ([LAG], {"servo_lag.time_constant": lag}) if lag else ([], {})
    synthetic = generate(fish, ["v1", "v3"], values=values, effects=effects, duration=8.0, seed=7)
    trials = tuple(_differentiated(trial, rng, motion=motion) for trial in synthetic.trials)
    return Problem(Model(fish), trials, Noise.white(SIGMA))


@pytest.mark.slow
def test_nothing_is_wrong_with_a_smoothed_motion_beside_a_run_shorter_than_the_filter() -> None:
    problem = _problem(0.0, motion=True)
    short = problem.trials[0]
    cut = replace(short, name="short", time=readonly(short.time[:15]), velocity=readonly(short.velocity[:15]))
    findings = screen(replace(problem, trials=(*problem.trials, cut)), (LAG,), None, walks=True)
    assert findings.evidence.problem.smoothing == Differentiator(3, 2)
    assert "differentiated over 3 samples, degree 2" in findings.remark
    assert findings.p_wrong >= THRESHOLDS.alarm


@pytest.mark.parametrize(
    ("motion", "lag"),
    [pytest.param(True, 0.01, marks=pytest.mark.slow), (False, 0.0), pytest.param(False, 0.01, marks=pytest.mark.slow)],
    ids=["motion and noise, lag", "noise alone", "noise alone, lag"],
)
def test_only_a_motion_that_was_smoothed_is_smoothed(lag: float, motion: bool) -> None:
    """Central differences at 50 Hz take a tenth of the second harmonic: far more than the noise hides."""
    findings = screen(_problem(lag, motion=motion), (LAG,), None, walks=True)
    found = findings.evidence.problem.smoothing
    assert found == (Differentiator(3, 2) if motion else None)
    assert ("differentiated over 3 samples, degree 2" in findings.remark) is motion
    assert (findings.p_wrong < THRESHOLDS.alarm) is (lag > 0.0)
    if lag:
        assert findings.refits["servo_lag"].fit.values["servo_lag.time_constant"] == pytest.approx(lag, rel=0.03)


@pytest.mark.slow
def test_half_a_window_is_left_out_where_a_filter_has_less_to_go_on() -> None:
    """Savitzky and Golay's filter goes on with its last polynomial at the ends; errors are far larger there."""
    last, middle = (signal.savgol_coeffs(11, 4, deriv=1, pos=place) for place in (0, 5))
    assert np.linalg.norm(last) > 4.0 * np.linalg.norm(middle)
    synthetic, rng = generate(load_fish("pike"), ["v1", "v3", "v5"], duration=8.0, seed=7), np.random.default_rng(3)
    trials = []
    for trial in synthetic.trials:
        noise = signal.savgol_filter(rng.standard_normal((len(trial.time), 3)), 11, 4, deriv=1, axis=0, mode="interp")
        trials.append(replace(trial, velocity=readonly(trial.velocity + SIGMA * noise / noise[11:-11].std(axis=0))))
    problem = Problem(Model(load_fish("pike")), tuple(trials), Noise.white(SIGMA))
    effects = tuple(find(name) for name in ("ambient_current", "velocity_scale", "time_offset", "inertia_error"))
    findings = screen(problem, effects, None, walks=True)
    assert findings.evidence.problem.ends == 5
    assert findings.p_wrong >= THRESHOLDS.alarm
