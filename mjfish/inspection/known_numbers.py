"""Numbers that the data put far from what is known of them.

With the rows of what is known in the fit (`mjfish.estimation.Problem.known`), d the deviation of an estimate in units
of its sd and h the leverage of its row, the estimate without that row lies d / (1 - h) from the expected value, and

    t = d / sqrt(1 - h) = (estimate of the data - expected) / sqrt(sd^2 + se^2)

is standard normal where both are right: the deleted residual of linear regression ([Cook1982], sec. 2.2).

[Cook1982] R. Cook, S. Weisberg, Residuals and Influence in Regression.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from mjfish.estimation import Fit, Problem
from mjfish.estimation.clocks import WALK
from mjfish.inspection.finding import Finding

#: P value of any number, corrected for how many are asked, below which it is said.
_LEVEL = 0.01
#: Leverage above which the data say nothing about a number.
_UNSEEN = 0.95


def contradicted(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Yield a finding for every number that the data alone put far from what is known of it.

    Args:
        problem: that was fitted.
        fit: of it.
    """
    rows, deviations = fit.jacobian.of_rows(slice(problem.measured, None)), -fit.residual[problem.measured :]
    left = 1.0 - np.sum((rows @ fit.covariance) * rows, axis=1)
    told = [f":{WALK}." not in problem.parameters[i].name for i in problem.known]  # a walk is drawn, not known
    asked = np.array(told, dtype=np.bool_) & (left > 1.0 - _UNSEEN)
    for row in np.flatnonzero(asked):
        t = deviations[row] / np.sqrt(left[row])
        if 2.0 * stats.norm.sf(abs(t)) * np.count_nonzero(asked) >= _LEVEL:
            continue
        p = problem.parameters[problem.known[row]]
        alone = p.at_deviation(float(deviations[row] / left[row]))
        yield Finding(
            code="far-from-known",
            severity="suspect",
            place=p.name,
            found=f"the data alone put it at {min(max(alone, p.low), p.high):.3g} {p.unit}".removesuffix(" -"),
            expected=f"{p.expected:.3g} with an sd of {p.sd:.2g} ({abs(t):.1f} sd away)",
            remedy="measure it again, give it a larger sd, or look for a cause that it makes up for",
            trials=tuple(filter(None, [p.name.rpartition(":")[0]])),
        )
