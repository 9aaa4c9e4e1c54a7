"""The integration step of a diagnosis: as long as its error is unseen, with a cause in the model, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.refit import converged_formula, finer, lowest, refit_with, resolved
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.05])
TAIL = find("tail_compliance")
#: Longest integration step [s].
LONGEST = 0.005


@pytest.fixture(scope="module")
def pike() -> Fish:
    return load_fish("pike")


def _problem(dataset: Dataset) -> Problem:
    return Problem(Model(dataset.fish), dataset.trials, Noise.white(SIGMA))


@pytest.mark.parametrize("modes", [["v1"], ["v5", "v7"]])
def test_the_step_is_as_long_as_its_error_is_unseen(pike: Fish, modes: list[str]) -> None:
    """Slow swimming takes the longest step; of quick swimming the error is near what may be, not far below it."""
    problem = _problem(generate(pike, modes, noise=SIGMA, duration=4.0, seed=1))
    chosen, x = resolved(problem)
    fine = replace(problem, model=replace(problem.model, step=0.001))
    error = float(np.sum((chosen.residual(x) - fine.residual(x)) ** 2))
    assert error < 0.15
    assert chosen.model.step <= LONGEST
    assert chosen.model.step == LONGEST or error > 0.005


def test_slopes_by_a_rougher_step_lead_to_the_same_fit(pike: Fish) -> None:
    """Residuals decide where a fit ends; slopes that were wrong, or of another model, would stop it elsewhere."""
    dataset = generate(pike, ["v3", "v5"], noise=SIGMA, duration=5.2, seed=4)
    rough, x = resolved(_problem(dataset))
    assert rough.slope_step == 3.0 * rough.model.step
    one, other = fit(rough, x), fit(replace(rough, slope_step=None), x)
    assert one.sse == pytest.approx(other.sse, abs=1e-3)
    mine, theirs = one.jacobian.dense(), other.jacobian.dense()
    np.testing.assert_allclose(mine, theirs, atol=0.01 * np.abs(theirs).max())
    assert np.any(mine != theirs)


def _jolted(pike: Fish, values: dict[str, float], sigma: FloatArray) -> Problem:
    """Return the nominal problem of a fish with an elastic tail that turns hard from side to side."""
    bias = np.array([0.0, -0.57, -1.13, -1.70])
    drive = tuple(DriveSegment(1.25 * k, 26.0, tuple((-1) ** k * bias)) for k in range(4))
    jolts, straight = generate(pike, ["v1", "v3"], duration=5.2).trials
    model, trials = Model(pike, (TAIL,), step=0.0005), []
    for k, trial in enumerate((replace(jolts, name="jolts", drive=drive), straight)):
        velocity = model.predict(trial, values).velocity
        velocity = velocity + sigma * np.random.default_rng(3 + k).standard_normal(velocity.shape)
        trials.append(replace(trial, velocity=readonly(velocity)))
    return Problem(Model(pike), tuple(trials), Noise.white(sigma))


@pytest.fixture(scope="module")
def jolted(pike: Fish) -> tuple[Problem, dict[str, float]]:
    """A nearly stiff tail, and the truth by name."""
    values = {p.name: p.start for p in pike.parameters}
    values |= {"tail_compliance.compliance": 0.0035, "tail_compliance.damping": 0.06}
    return _jolted(pike, values, 0.3 * SIGMA), values


def test_a_tail_that_is_nearly_stiff_asks_for_a_shorter_step(jolted: tuple[Problem, dict[str, float]]) -> None:
    """Where the fish turns hard it jerks: by the step of the nominal model its size comes out wrong by many sigma."""
    nominal, values = jolted
    coarse = replace(nominal, model=Model(nominal.model.fish, (TAIL,), step=LONGEST))

    def off(problem: Problem) -> float:
        result = fit(problem, problem.start(values))
        return max(abs(result.values[p.name] - values[p.name]) / result.sigma[p.name] for p in TAIL.parameters)

    fine = finer(coarse, coarse.start(values), 1e-5)
    assert fine.slope_step == 3.0 * fine.model.step
    assert off(fine) < 3.0
    assert off(coarse) > 4.0


@pytest.mark.slow
def test_a_ringing_tail_is_found_beyond_the_local_minima_of_other_stiffnesses(
    jolted: tuple[Problem, dict[str, float]],
) -> None:
    """From a tail that is stiffer the fit ends where it rings a whole turn more often; short stretches lead out."""
    nominal, values = jolted
    problem, x = resolved(nominal)
    coarse = refit_with(gather(problem, fit(problem, x), [TAIL]), TAIL)
    name = TAIL.parameters[0].name
    assert fit(coarse.problem, coarse.fit.x, tolerance=1e-5).values[name] < 0.7 * values[name]
    wrong = converged_formula(coarse, coarse.fit.sse)
    assert wrong.fit.values[name] < 0.7 * values[name]
    found = lowest(wrong)
    assert found.fit.values[name] == pytest.approx(values[name], rel=0.02)
    assert found.fit.sse < 1.2 * len(found.fit.residual)
    assert found.problem.model.step < problem.model.step
