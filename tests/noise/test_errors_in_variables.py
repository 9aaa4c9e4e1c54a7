"""Errors of measured joint angles in the noise of a diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish import ode
from mjfish.data import Dataset, Trial
from mjfish.diagnosis import diagnose
from mjfish.drive.measured import joint_motion, smoothing
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.noise_of_fit import JointErrors, joint_errors
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.noise import ErrorsInVariables
from mjfish.numerics.arrays import FloatArray

SIGMA = np.array([0.004, 0.004, 0.025])
TIME = np.arange(200) / 50.0
AMPLITUDES, LAGS = np.array([0.15, 0.25, 0.35, 0.45]), 1.2 * np.arange(4)


def _angles(beat: float) -> FloatArray:
    return np.asarray(AMPLITUDES * np.sin(2.0 * np.pi * beat * TIME[:, None] - LAGS))


def _trial(fish: Fish, beat: float, rng: np.random.Generator, wrong: FloatArray | float = 0.0) -> Trial:
    """Return a trial whose joint angles were read with errors `wrong` (200, 4)."""
    truth = joint_motion(TIME, _angles(beat), 0.002)
    swum = ode.simulate(fish, truth, values=fish.values, velocity=np.array([0.2, 0.0, 0.0])).at(TIME)[:, :3]
    noise = SIGMA * rng.standard_normal((200, 3))
    return Trial(f"beat-{beat:g}", None, TIME, swum + noise, joint_angle=_angles(beat) + wrong)


def _problem(trials: tuple[Trial, ...], fish: Fish) -> Problem:
    return Problem(Model(fish, step=0.005), trials, Noise.white(SIGMA))


def _misread(trial: Trial, fish: Fish) -> tuple[Problem, JointErrors]:
    problem = _problem((trial,), fish)
    start = {f"{trial.name}:start.{c}": v for c, v in zip(("surge", "sway", "yaw_rate"), (0.2, 0.0, 0.0), strict=True)}
    return problem, JointErrors(problem, {**fish.values, **start})


def test_a_mode_reaches_the_velocities_as_the_model_says(pike: Fish) -> None:
    """The prediction from angles without the error, less that from angles with it: its sign, and its own velocities."""
    rng = np.random.default_rng(1)
    modes = np.zeros((2, 200, 7))
    modes[0, :, 3 + 1] = 0.01 * np.sin(5.0 * TIME)
    modes[1, :, 0], modes[1, :, 3 + 3] = 0.002, 0.01 * np.cos(8.0 * TIME)
    trial = replace(_trial(pike, 1.3, rng), errors=modes)
    problem, through = _misread(trial, pike)
    found = through.loadings(trial)
    for k, mode in enumerate(modes):
        pair = [
            problem.prediction(replace(trial, joint_angle=_angles(1.3) + side * mode[:, 3:]), through.values).velocity
            for side in (0.1, -0.1)
        ]
        expected = mode[:, :3] - (pair[0] - pair[1]) / 0.2
        np.testing.assert_allclose(found[:, :, k], expected, atol=0.02 * np.abs(expected).max())


def test_noise_with_errors_in_variables_is_white_after_whitening(pike: Fish) -> None:
    """Draws of the very noise: unit variance, and nothing left along the modes."""
    rng = np.random.default_rng(2)
    modes = np.zeros((3, 200, 7))
    modes[:, :, 3:] = 0.03 * np.stack([np.sin((4 + 2 * k) * TIME)[:, None] * np.eye(4)[k] for k in range(3)])
    trial = replace(_trial(pike, 1.3, rng), errors=modes)
    problem, through = _misread(trial, pike)
    noise = ErrorsInVariables.of(Noise.white(SIGMA), through.loadings)
    h, mask = through.loadings(trial), problem.mask(0)
    covariance = np.einsum("ncm,kdm->nckd", h, h) + SIGMA**2 * np.einsum("nk,cd->nckd", np.eye(200), np.eye(3))
    counted = covariance[mask][:, :, mask].reshape((3 * np.count_nonzero(mask),) * 2)
    assert noise.log_determinant(trial, mask) == pytest.approx(np.linalg.slogdet(counted)[1])
    draws = rng.standard_normal((3, 400))
    block = (h @ draws + SIGMA[:, None] * rng.standard_normal((200, 3, 400)))[mask]
    assert np.square(block / SIGMA[:, None]).mean() > 1.5
    white = noise.whiten(trial, mask, block).reshape(-1, 400)
    assert np.square(white).mean() == pytest.approx(1.0, abs=0.02)
    along = np.linalg.qr((h[mask] / SIGMA[:, None]).reshape(len(white), -1))[0]
    assert np.square(along.T @ white).mean() == pytest.approx(1.0, abs=0.15)


def test_exact_angles_have_no_errors_to_allow_for(pike: Fish) -> None:
    trial = _trial(pike, 1.3, np.random.default_rng(3))
    problem = _problem((trial,), pike)
    assert joint_errors(problem, fit(problem)) is None


def test_smoothing_knows_the_noise_of_the_angles() -> None:
    rng = np.random.default_rng(4)
    found = [smoothing(TIME, _angles(1.0)[:, 3] + 0.005 * rng.standard_normal(200)).sigma for _ in range(12)]
    assert np.median(found) == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_noise_of_the_angles_is_not_taken_for_something_wrong(pike: Fish, seed: int) -> None:
    """Angles read with 0.004 rad of white noise: what they do to the yaw rate is as large as the camera's noise."""
    rng = np.random.default_rng([20, seed])
    trials = tuple(
        replace(
            _trial(pike, beat, rng, 0.004 * rng.standard_normal((200, 4))), role="held_out" if beat == 1.2 else "fit"
        )
        for beat in (0.9, 1.2, 1.6)
    )
    found = diagnose(Dataset("noisy joints", pike, trials, noise=SIGMA))
    assert found.verdict == "nothing_wrong", found.message
