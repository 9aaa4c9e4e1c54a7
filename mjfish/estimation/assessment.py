"""What the data say about a fit: how sure its numbers are, what they do not say, what is left, how well it swims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mjfish.estimation.agreement import Agreement, agreement
from mjfish.estimation.criteria import Criteria, criteria
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.residuals.residual import Residual
from mjfish.estimation.residuals.residual_tests import ResidualTests, residual_tests
from mjfish.estimation.table_iv import Row, table_iv
from mjfish.estimation.uncertainty.intervals import Intervals, intervals
from mjfish.estimation.uncertainty.stability import Stability, stability
from mjfish.estimation.uncertainty.weak import Weakness, weaknesses


@dataclass(frozen=True, eq=False)
class Assessment:
    """Everything that is said about a fit that did not diverge.

    Attributes:
        residuals: of fitted trials, then of those held out.
        intervals: of the estimates, for residuals that are correlated in time, the plain ones beside them.
        weaknesses: what the data do not say, in words.
        agreements: per trial, channel, part of the trial and horizon.
        table: in the layout of [Yu2016], Table IV.
        tests: whether anything is left in the residuals of the fit.
        criteria: AIC, AICc, BIC, FPE.
        stability: whether one set of coefficients serves all trials.
    """

    residuals: tuple[Residual, ...]
    intervals: Intervals
    weaknesses: tuple[Weakness, ...]
    agreements: tuple[Agreement, ...]
    table: tuple[Row, ...]
    tests: ResidualTests
    criteria: Criteria
    stability: Stability

    def to_dict(self) -> dict[str, Any]:
        """Return the assessment as plain data; the residuals themselves are not in it."""
        return {
            "intervals": self.intervals.to_dict(),
            "weaknesses": [one.to_dict() for one in self.weaknesses],
            "agreement": [one.to_dict() for one in self.agreements],
            "table": [row.to_dict() for row in self.table],
            "residual_tests": self.tests.to_dict(),
            "criteria": self.criteria.to_dict(),
            "stability": self.stability.to_dict(),
        }


def assess(problem: Problem, fit: Fit, residuals: tuple[Residual, ...]) -> Assessment | None:
    """Assess a fit; None where it diverged, for then the data say nothing about it.

    Args:
        problem: that was fitted.
        fit: of it.
        residuals: of its trials, then of those that had no part in it.
    """
    if fit.status == "diverged":
        return None
    own = residuals[: len(problem.trials)]
    return Assessment(
        residuals=residuals,
        intervals=intervals(problem, fit),
        weaknesses=weaknesses(fit),
        agreements=tuple(agreement(residuals)),
        table=table_iv(residuals),
        tests=residual_tests(problem, fit, own),
        criteria=criteria(problem, fit, own),
        stability=stability(problem, fit),
    )
