"""A noise model that was saved as plain data whitens as it did."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.estimation import Noise, Problem
from mjfish.estimation.noise_of_fit import JointErrors, restore, state_jacobians
from mjfish.files.plain_data import plain
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.noise import (
    Autoregressive,
    DifferentiationNoise,
    ErrorsInVariables,
    GaussMarkov,
    NoiseByRate,
    ProcessNoise,
)

SIGMA = np.array([0.01, 0.02, 0.05])
PHI = np.array([[0.5, 0.1], [0.2, 0.0], [-0.3, 0.1]])


def _problem(*, measured: bool) -> Problem:
    model = Model(load_fish("pike"))
    time = np.arange(0.0, 1.201, 0.02)
    trial = Trial("v1", "fit", time, np.zeros((len(time), 3)), modes.drive("v1"))
    run = model.predict(trial, model.values())
    if measured:
        angles = 0.3 * np.sin(18.0 * time[:, None] - np.arange(4.0))
        trial = Trial("v1", "fit", time, run.velocity, joint_angle=angles)
    return Problem(model, (trial,), Noise.white(SIGMA))


def _noises(problem: Problem, values: dict[str, float]) -> dict[str, Noise]:
    coloured = Autoregressive(SIGMA, PHI)
    return {
        "white": Noise.white(SIGMA),
        "autoregressive": coloured,
        "differentiation": DifferentiationNoise(SIGMA, window=5, degree=2, rounding=0.1),
        "Gauss-Markov": GaussMarkov(SIGMA, drift=SIGMA, time=np.array([0.2, 0.3, 0.4])),
        "by rate": NoiseByRate.of({0.02: coloured, 0.01: Noise.white(SIGMA)}),
        "process": ProcessNoise(SIGMA, push=3.0 * SIGMA, time=0.3, jacobians=state_jacobians(problem, values)),
        "errors in variables": ErrorsInVariables.of(coloured, JointErrors(problem, values).loadings),
    }


@pytest.mark.parametrize(
    "kind",
    ["white", "autoregressive", "differentiation", "Gauss-Markov", "by rate", "process", "errors in variables"],
)
def test_a_saved_noise_whitens_as_it_did(kind: str) -> None:
    problem = _problem(measured=kind == "errors in variables")
    values = problem.named(problem.start())
    noise = _noises(problem, values)[kind]
    again = restore(json.loads(json.dumps(plain(noise))), problem, values)
    assert type(again) is type(noise)
    mask = problem.mask(0)
    block = np.random.default_rng(0).normal(size=(int(mask.sum()), 3, 2))
    trial = problem.trials[0]
    np.testing.assert_allclose(again.whiten(trial, mask, block), noise.whiten(trial, mask, block), rtol=1e-9)
