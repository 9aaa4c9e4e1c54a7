"""A noise model that was saved as plain data whitens as it did."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.estimation import Noise, Problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.noise.coloured import Coloured
from mjfish.noise.differentiated import Differentiated
from mjfish.noise.drifting import Drifting
from mjfish.noise.forces import Pushed, along
from mjfish.noise.misread import Misread, Misreading
from mjfish.noise.restore import restore
from mjfish.noise.stepwise import Stepwise
from mjfish.serialise import plain

SIGMA, WHITE = np.array([0.01, 0.02, 0.05]), np.zeros((3, 0))
PHI = np.array([[0.5, 0.1], [0.2, 0.0], [-0.3, 0.1]])


def _problem(*, measured: bool) -> Problem:
    model = Model(load_fish("pike"))
    time = np.arange(0.0, 1.201, 0.02)
    trial = Trial("v1", "fit", time, np.zeros((len(time), 3)), modes.drive("v1"))
    run = model.predict(trial, model.values())
    if measured:
        angles = 0.3 * np.sin(18.0 * time[:, None] - np.arange(4.0))
        trial = Trial("v1", "fit", time, run.velocity, joint_angle=angles)
    return Problem(model, (trial,), Noise.white(SIGMA), jobs=1)


def _noises(problem: Problem, values: dict[str, float]) -> dict[str, Noise]:
    coloured = Coloured(SIGMA, PHI)
    return {
        "plain": Noise(SIGMA, PHI),
        "coloured": coloured,
        "differentiated": Differentiated(SIGMA, WHITE, 5, 2, 0.1),
        "drifting": Drifting(SIGMA, WHITE, SIGMA, np.array([0.2, 0.3, 0.4])),
        "by rate": Stepwise.of({0.02: coloured, 0.01: Coloured(SIGMA, WHITE)}),
        "pushed": Pushed(SIGMA, WHITE, 3.0 * SIGMA, 0.3, along(problem, values)),
        "misread": Misread.of(coloured, Misreading(problem, values)),
    }


@pytest.mark.parametrize("kind", ["plain", "coloured", "differentiated", "drifting", "by rate", "pushed", "misread"])
def test_a_saved_noise_whitens_as_it_did(kind: str) -> None:
    problem = _problem(measured=kind == "misread")
    values = problem.named(problem.start())
    noise = _noises(problem, values)[kind]
    again = restore(json.loads(json.dumps(plain(noise))), problem, values)
    assert type(again) is type(noise)
    mask = problem.mask(0)
    block = np.random.default_rng(0).normal(size=(int(mask.sum()), 3, 2))
    trial, starts = problem.trials[0], problem.stretches(0)
    np.testing.assert_allclose(
        again.of_trial(trial, mask, block, starts), noise.of_trial(trial, mask, block, starts), rtol=1e-9
    )
