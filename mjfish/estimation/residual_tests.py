"""Residual analysis in one call: whiteness, and independence of the input, with one p value for each question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjfish.errors import InputError
from mjfish.estimation.fit import Fit
from mjfish.estimation.independence import Absorbed, CrossCorrelation, absorbed, independence
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Residual, fitted
from mjfish.estimation.whiteness import ALL, LAGS, Autocorrelation, whiteness
from mjfish.fish import Cpg
from mjfish.noise import Noise

Status = Literal["passed", "coloured", "dependent", "untested"]
#: A residual whose p value is below this fails.
LEVEL = 0.01


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Whether anything is left in the residual.

    Attributes:
        whiteness: per channel, every trial and then all.
        independence: per channel and input, every trial and then all.
        p_white: chance of the least white channel, over all trials, if all are; three times the smallest p value.
        p_independent: the same of the channels and inputs.
        skipped: trials whose rollout diverged.
        status: ``passed``; ``coloured`` (independent of the input, not white: intervals that assume white noise are too
            narrow, the model may be right), ``dependent`` (the model misses something that the drive does) or
            ``untested`` (every rollout diverged).
    """

    whiteness: tuple[Autocorrelation, ...]
    independence: tuple[CrossCorrelation, ...]
    p_white: float
    p_independent: float
    skipped: tuple[str, ...]
    status: Status


def residual_tests(
    problem: Problem, fit: Fit, residuals: Sequence[Residual] | None = None, *, lags: int = LAGS
) -> ResidualTests:
    """Test the residuals of a fit, which are made here where they are not given."""
    taken = None if fit.status == "diverged" else absorbed(problem, fit)
    return examine(residuals or fitted(problem, fit.x), problem.noise, problem.model.fish.cpg, taken, lags=lags)


def examine(
    residuals: Sequence[Residual],
    noise: Noise,
    cpg: Cpg | None,
    taken: Absorbed | None = None,
    *,
    lags: int = LAGS,
    spent: int | None = None,
) -> ResidualTests:
    """Test residuals, of fitted or of held-out trials.

    Args:
        residuals: of the trials.
        noise: what they are said to be.
        cpg: of the fish.
        taken: what the fit took out of them; None for held-out trials.
        lags, spent: see `mjfish.estimation.whiteness.whiteness`.
    """
    reached = [residual for residual in residuals if not residual.diverged]
    skipped = tuple(residual.trial.name for residual in residuals if residual.diverged)
    if taken is not None and skipped:
        raise InputError(
            f"trials {', '.join(skipped)} diverged, what a fit took out of them is not known; leave it out"
        )
    if not reached:
        return ResidualTests((), (), np.nan, np.nan, skipped, "untested")
    white = whiteness(reached, noise, lags=lags, spent=spent)
    independent = independence(reached, cpg, taken)
    p_white, p_independent = _least(white), _least(independent)
    status: Status = "passed"
    if p_independent < LEVEL:
        status = "dependent"
    elif p_white < LEVEL:
        status = "coloured"
    return ResidualTests(white, independent, p_white, p_independent, skipped, status)


def _least(tests: Sequence[Autocorrelation] | Sequence[CrossCorrelation]) -> float:
    """Return the smallest p value over all trials, times how many there are (Bonferroni); NaN without any."""
    found = [one.p_value for one in tests if one.trial == ALL and np.isfinite(one.p_value)]
    return min(1.0, len(found) * min(found)) if found else np.nan
