"""A fit begins at the shapes at which the score is largest."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.refit import at_best_shapes, refit_with
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

NOISE = np.array([0.004, 0.004, 0.03])
TRUTH = {"wake_memory.share": 0.05, "wake_memory.time": 0.7}


@pytest.fixture(scope="module")
def remembering(pike: Fish) -> Problem:
    """Runs of a fish whose water forgets slowly, ten times more slowly than where the shape has its default."""
    modes = ["v1", "v5-v1", "v3"]
    data = generate(pike, modes, values=TRUTH, effects=[find("wake_memory")], noise=NOISE, duration=6.0, seed=3)
    return Problem(Model(pike), data.trials, Noise.white(NOISE))


def test_the_score_is_largest_near_the_true_shape(remembering: Problem) -> None:
    effect = find("wake_memory")
    nominal = gather(remembering, fit(remembering), [effect])
    best, shapes = at_best_shapes(nominal, effect)
    assert best.statistic("wake_memory") > 1.02 * nominal.statistic("wake_memory")
    default = effect.declaration("time").default
    assert abs(np.log(shapes["wake_memory.time"] / 0.7)) < abs(np.log(default / 0.7))


def test_a_refit_that_begins_there_ends_at_the_truth(remembering: Problem) -> None:
    effect = find("wake_memory")
    found = refit_with(gather(remembering, fit(remembering), [effect]), effect)
    here = fit(found.problem, found.fit.x)
    assert here.values["wake_memory.time"] == pytest.approx(0.7, rel=0.3)


def test_a_cause_without_shapes_has_the_score_it_had(remembering: Problem) -> None:
    effect = find("munk_moment")
    nominal = gather(remembering, fit(remembering), [effect])
    best, shapes = at_best_shapes(nominal, effect)
    assert shapes == {}
    assert best.statistic("munk_moment") == pytest.approx(nominal.statistic("munk_moment"), rel=1e-9)
