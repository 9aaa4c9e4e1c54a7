"""A fit along a narrow and curved valley: bounds that are far away cost it nothing, and near ones are kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from linear_problem import Linear, linear
from scipy.optimize import least_squares

from mjfish.arrays import FloatArray
from mjfish.block_angular import BlockAngular
from mjfish.estimation import fit

#: What no parameter explains, so that the relative change of the cost means something.
LEFT = 30.0
START = np.array([0.02, 0.4])


@dataclass(frozen=True, eq=False)
class Valley(Linear):
    """Residuals 2000 (x + y - sum + (x - y)^2 / 10), 3 (x - y - apart) and `LEFT`, of x and y from 0 to 1.

    Attributes:
        total, apart: where the least is.
    """

    total: float = 0.6
    apart: float = 0.0

    def residual(self, x: FloatArray) -> FloatArray:
        """Return what is left."""
        d = x[0] - x[1]
        return np.array([2000.0 * (x[0] + x[1] - self.total + 0.1 * d * d), 3.0 * (d - self.apart), LEFT])

    def jacobian(self, x: FloatArray) -> BlockAngular:
        """Return the derivative of what is predicted."""
        d = x[0] - x[1]
        rows = [[2000.0 * (1.0 + 0.2 * d), 2000.0 * (1.0 - 0.2 * d)], [3.0, -3.0], [0.0, 0.0]]
        return BlockAngular.of(-np.array(rows))


def _valley(total: float, apart: float) -> Valley:
    like = linear(np.zeros((3, 2)), np.zeros(3), ())
    effect = like.model.effects[0]
    declared = tuple(p.rebound(low=0.0, high=1.0) for p in effect.parameters)
    model = type(like.model)(like.model.fish, (type("Toy", (type(effect),), {"parameters": declared})(),))
    return Valley(
        model, (), like.noise, like.fixed, design=like.design, data=like.data, jobs=1, total=total, apart=apart
    )


def test_bounds_that_are_far_away_cost_nothing() -> None:
    """The interior method alone takes twice the evaluations: its steps are scaled by distances to bounds."""
    valley = _valley(0.6, 0.0)
    found = fit(valley, START, tolerance=1e-6)
    alone = least_squares(
        valley.residual, START, jac=lambda x: -valley.jacobian(x).dense(), bounds=(0.0, 1.0), x_scale="jac", ftol=1e-6
    )
    np.testing.assert_allclose(found.x, [0.3, 0.3], atol=1e-4)
    assert found.status == "converged"
    assert found.evaluations < 0.6 * alone.nfev


@pytest.mark.parametrize("apart", [0.4, -0.4])
def test_the_least_within_bounds_is_found_on_one_of_them(apart: float) -> None:
    """The least of all is at 1.1 and 0.7, or the other way round; on the bound the floor of the valley is at 0.8125."""
    found = fit(_valley(1.8 + 0.1 * apart**2, apart), START, tolerance=1e-6)
    expected = [1.0, 0.8125] if apart > 0.0 else [0.8125, 1.0]
    np.testing.assert_allclose(found.x, expected, atol=1e-3)
    assert found.at_bound.tolist() == [value == 1.0 for value in expected]
