"""The integration step: as long as its error is one that the data cannot see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis.failures import NOMINAL, sound
from mjfish.estimation import Problem, fit

#: Longest and shortest integration step [s], and what its error may add to a sum of squares in units of the noise.
_LONGEST, _SHORTEST = 0.005, 0.00125
_UNSEEN = 0.1
#: Power of the step by which that falls, a little less than the eight of a method of fourth order.
_POWER = 7.0
#: Step of the derivatives in steps of the rollouts.
_SLOPES = 2.0


def resolved(problem: Problem) -> tuple[Problem, FloatArray]:
    """Return the problem with the longest step whose error the data cannot see, and the fit there as a start.

    The error is the change of the whitened prediction on halving the step; its sum of squares is what the step adds to
    any statistic.
    """
    rough = _stepped(problem, _LONGEST)
    x = sound(NOMINAL, fit(rough, tolerance=1e-4)).x
    error = float(np.sum((rough.residual(x) - _stepped(problem, 0.5 * _LONGEST).residual(x)) ** 2))
    return _stepped(problem, max(_LONGEST * min(_UNSEEN / max(error, 1e-300), 1.0) ** (1.0 / _POWER), _SHORTEST)), x


def finer(problem: Problem, x: FloatArray, share: float) -> Problem:
    """Return the problem with its step halved as often as its error at x is seen: a cause may ask for more.

    Where the tail is nearly stiff, or servos jerk, the error falls by no power that is known beforehand.

    Args:
        problem: of an extended model.
        x: where it has been fitted.
        share: of the sum of squares at x that an error may be as well: less than the fit is followed to.
    """
    here = problem.residual(x)
    unseen = max(_UNSEEN, share * float(here @ here))
    while (step := 0.5 * problem.model.step) >= _SHORTEST:
        half = _stepped(problem, step)
        there = half.residual(x)
        if np.sum((there - here) ** 2) < unseen:
            break
        problem, here = half, there
    return problem


def _stepped(problem: Problem, step: float) -> Problem:
    return replace(problem, model=replace(problem.model, step=step), slope_step=_SLOPES * step)
