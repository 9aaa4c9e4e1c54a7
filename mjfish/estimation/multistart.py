"""Fits from many starts: is the optimum that was found the only one, and the best?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from mjfish.arrays import FloatArray
from mjfish.estimation.fit import Fit, fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.settings import Loss
from mjfish.parameter import bounds

#: Evaluations of a fit on its way; the best goes on to the end.
_SCOUT = 25
_SCOUT_TOLERANCE = 1e-5
#: A start reached the best optimum where its cost is above the best by no more than this share, or by 1 in 2 log L.
SAME = 1e-3


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Fits from several starts.

    Attributes:
        best: the best fit, converged.
        costs: (k,) sum of (robust) squares that each start reached; infinite where it diverged.
        optima: (k, p) where each ended.
        reached: share of the starts that reached the best optimum.
    """

    best: Fit
    costs: FloatArray
    optima: FloatArray
    reached: float


def multistart(
    problem: Problem,
    starts: int,
    *,
    seed: int = 0,
    loss: Loss = "linear",
    loss_scale: float = 1.0,
    tell: Callable[[float], None] | None = None,
) -> MultiStart:
    """Fit from the declared start and from a Latin hypercube over the bounds [McKay1979].

    The same seed gives the same answer for any number of jobs: starts are drawn at once, and fits share nothing.

    [McKay1979] M. McKay, R. Beckman, W. Conover: A comparison of three methods for selecting values of input variables.

    Args:
        problem: what is fitted.
        starts: number of starts, the declared one among them.
        seed: of the hypercube.
        loss, loss_scale: as in `fit`.
        tell: called with the share that is done.
    """
    points = [problem.start(), *hypercube(problem, starts - 1, seed)]
    scouts = []
    for done, point in enumerate(points):
        if tell is not None:
            tell(done / len(points))
        short = {} if starts == 1 else {"tolerance": _SCOUT_TOLERANCE, "evaluations": _SCOUT}
        scouts.append(fit(problem, point, loss=loss, loss_scale=loss_scale, **short))  # type: ignore[arg-type]
    costs = np.array([_cost(one) for one in scouts])
    order = int(np.argmin(costs))
    best, evaluations = scouts[order], sum(one.evaluations for one in scouts)
    if starts > 1:
        best = fit(problem, best.x, loss=loss, loss_scale=loss_scale)
        costs[order] = min(costs[order], _cost(best))
        evaluations += best.evaluations
    slack = max(SAME * float(costs.min()), 1.0)
    return MultiStart(
        best=replace(best, evaluations=evaluations),
        costs=costs,
        optima=np.array([one.x for one in scouts]),
        reached=float(np.mean(np.isfinite(costs) & (costs <= costs.min() + slack))),
    )


def hypercube(problem: Problem, count: int, seed: int) -> FloatArray:
    """Return starts (count, p): nuisance parameters of trials stay at their own, which the data give."""
    parameters = problem.parameters
    x = np.tile(problem.start(), (count, 1))
    shared = [i for i, p in enumerate(parameters) if ":" not in p.name]
    if count and shared:
        low, high = bounds([parameters[i] for i in shared])
        x[:, shared] = low + (high - low) * qmc.LatinHypercube(len(shared), rng=np.random.default_rng(seed)).random(
            count
        )
    return x


def _cost(one: Fit) -> float:
    return np.inf if one.status == "diverged" else one.cost
