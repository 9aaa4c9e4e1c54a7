"""Both optima that the paper's data leave open, Table III's lambda* and the alternative one, are found again.

They swim alike in the ranges of Table IV but are worlds apart in their coefficients, and both have some at their
bounds; the fit starts from the paper's start values, between the two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from scipy import stats
from synthetic_swimming import SIGMA

from mjfish.drive import modes
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.fit import Z95
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate

#: Coefficients in the order of `COEFFICIENTS`: c_m, c_d, c_f of head, body, tail.
OPTIMA = {
    "lambda_star": (0.01, 0.07, 0.06, 4.0, 1.5, 2.5, 0.02, 0.02, 0.02),
    "alternative": (3.0, 0.01, 0.40, 4.0, 0.1, 0.18, 0.02, 0.010, 0.009),
}
#: Largest distance of an estimate on a wrong bound from a truth strictly inside, in standard errors without the bound.
_REACH = 4.0


def _fitted(fish: Fish, optimum: str, names: Sequence[str], duration: float) -> tuple[Fit, Problem, np.ndarray]:
    """Simulate an optimum of the paper; fit all nine coefficients from the start values of Table III."""
    values = dict(zip(COEFFICIENTS, OPTIMA[optimum], strict=True))
    dataset = generate(fish, names, values=values, noise=SIGMA, duration=duration, seed=0)
    problem = Problem(Model(fish), dataset.trials, Noise.white(readonly(SIGMA)))
    assert problem.start().tolist() == [0.5] * 3 + [2.0] * 3 + [0.01] * 3
    return fit(problem), problem, np.array([values[p.name] for p in problem.parameters])


def _check(found: Fit, problem: Problem, truth: np.ndarray, z: float) -> None:
    """Check status, cost and every estimate; what rests on a bound has its truth there, or near it."""
    assert found.status == "converged"
    assert len(found.x) == 9
    at_truth = problem.residual(truth)
    assert found.sse <= float(at_truth @ at_truth)
    for p, at, true, reach, rests in zip(found.parameters, found.x, truth, found.reach, found.at_bound, strict=True):
        low, high = found.interval(p.name, z)
        assert low <= true <= high, f"{p.name} = {at:g} in [{low:g}, {high:g}], true {true:g}"
        if rests:
            assert at in (p.low, p.high)
            assert abs(at - true) < _REACH * reach, p.name


@pytest.mark.parametrize("optimum", OPTIMA)
def test_an_optimum_is_found_again_in_three_short_trials(pike: Fish, optimum: str) -> None:
    """Within four standard errors. Catches a fit that stays in the other optimum or stops on a bound on its way."""
    _check(*_fitted(pike, optimum, ("v1", "v5", "v7"), 3.0), z=4.0)


@pytest.mark.slow
@pytest.mark.parametrize("optimum", OPTIMA)
def test_an_optimum_is_found_again_in_the_modes_of_table_iv(pike: Fish, optimum: str) -> None:
    """Ten modes of 10.4 s: every truth in its 95 % interval, all of them well known.

    Catches what only long data tell, such as generating and fitting models whose steps do not agree.
    """
    found, problem, truth = _fitted(pike, optimum, modes.MODES, modes.DURATION)
    _check(found, problem, truth, z=Z95)
    inside = ~found.at_bound
    assert np.all(np.sqrt(np.diag(found.covariance))[inside] < 0.2 * truth[inside])
    off = (found.x - truth)[inside]
    squares = float(off @ np.linalg.inv(found.covariance[np.ix_(inside, inside)]) @ off)
    assert squares < stats.chi2.ppf(0.9999, len(off))
