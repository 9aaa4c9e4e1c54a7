"""A cause that does nothing up to some size has no score: beside another one it is seen by its refit alone."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.refit import converged_formula, refit_with
from mjfish.diagnosis.select import Goodness
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

NOISE = np.array([0.006, 0.006, 0.04])


@pytest.mark.parametrize(("slowness", "hidden"), [(0.0, False), (0.055, False), (0.0573, True)])
def test_a_speed_limit_of_the_servos_beside_turned_axes_is_seen_by_its_refit_alone(
    slowness: float, hidden: bool
) -> None:
    """At 0.055 s/rad no servo of these runs comes to its limit."""
    pike, turned, limit = load_fish("pike"), find("frame_misalignment"), find("servo_rate_limit")
    values = {"frame_misalignment.angle": 0.005, "servo_rate_limit.slowness": slowness}
    pool = generate(pike, ["v1", "v3", "v5"], values=values, effects=[turned, limit], noise=NOISE, duration=5.0, seed=3)
    problem = Problem(Model(pike), pool.trials, Noise.white(NOISE))
    evidence = gather(problem, fit(problem), [turned])
    refit = converged_formula(refit_with(evidence, turned), np.inf)
    row = Goodness([limit, find("time_offset")], HeldOut(evidence, ())).of(refit, Row.of(refit.names, refit))
    unseen = row.tests["unseen causes"]
    assert (unseen < 1e-6) if hidden else (unseen > 0.01)
    assert min(p for test, p in row.tests.items() if test != "unseen causes") >= THRESHOLDS.goodness
    assert row.clean() is not hidden
