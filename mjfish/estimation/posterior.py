"""The posterior of a fit: mean, covariance and scatter of the parameters that all runs share.

With the whitened Jacobian J of all free parameters and the roots P of their priors, errors have the covariance

    B = (J'J + P'P)^-1,    or where residuals are correlated in time    B (J' Omega J + P'P) B,

the first as the intervals of a diagnosis, whose noise model whitens the residuals, the second as those of an
identification (`mjfish.estimation.intervals`). Estimates on a bound count as free: how far they may lie from it, and
how the others then follow, is in the covariance. Every parameter has a Gaussian prior about its estimate, as wide as
its bounds are apart: what the data do not say stays finite. Of one that they know to a tenth of its range this takes
0.5 % off the standard error.

A coefficient that a learned curve scales, as in c_d exp(curve), is known in its product with it alone. A Gaussian of
both is wide along that hyperbola and leaves it. So the coefficient is held, and the curve has all of the error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mjfish.arrays import BoolArray
from mjfish.block_angular import span
from mjfish.estimation.fit import Fit, covariance
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import middle, serial, serial_blocks
from mjfish.fish import Fish
from mjfish.model.posterior import Posterior
from mjfish.parameter import bounds


def posterior(problem: Problem, fit: Fit, fish: Fish, scatter: Mapping[str, float], *, correlated: bool) -> Posterior:
    """Return the posterior of a fit that did not diverge, without parameters of single trials.

    Args:
        problem: that was fitted.
        fit: of it.
        fish: with values and bounds of the fit (`mjfish.estimation.identification.identified_fish`).
        scatter: from run to run, by name (`mjfish.estimation.scatter`); what is not named has none.
        correlated: whether the whitened residuals may be correlated in time.
    """
    low, high = bounds(fit.parameters)
    factors = fit.jacobian.above(np.concatenate([problem.prior_root, np.diag(1.0 / (high - low))])).factors
    errors = covariance(factors.triangle, _stood_in_for(problem, fit))
    if correlated:
        blocks = serial_blocks(problem, fit.residual)
        found = serial(blocks, fit.jacobian.chosen(~fit.at_bound).top(problem.measured).factors.basis)
        moves = factors.triangle @ errors
        errors = moves.T @ middle(found, blocks, factors.basis, problem.measured) @ moves
    own = {p.name for p in problem.model.parameters}
    shared = [k for k, p in enumerate(fit.parameters) if p.name in own]
    names = tuple(fit.parameters[k].name for k in shared)
    return Posterior(
        model=replace(problem.model, fish=fish),
        names=names,
        mean=fit.x[shared],
        covariance=errors[np.ix_(shared, shared)],
        scatter=np.array([scatter.get(name, 0.0) for name in names]),
        runs=len(problem.trials),
    )


def _stood_in_for(problem: Problem, fit: Fit) -> BoolArray:
    """Return which parameters (p,) are coefficients for which learned curves stand in.

    Those of a model with priors that the data without them know no better than to their own size, one after the other.
    """
    held = np.zeros_like(fit.at_bound)
    for k, p in enumerate(fit.parameters):
        if problem.priors and p.name in problem.model.fish.coefficient_names:
            others = ~held
            others[k] = False
            own = span(fit.jacobian.chosen(others)).off(fit.jacobian.of_columns([k])[:, 0])
            held[k] = float(own @ own) * fit.x[k] ** 2 < 1.0
    return held
