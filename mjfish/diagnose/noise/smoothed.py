"""Whether the motion went through the filter that the noise went through: by what predictions explain that do, too.

Velocities that are not white in their noise were differentiated, smoothed, or both, and the motion with them. The noise
may have come in later all the same; so each filter is tried on the prediction, and taken where the data are clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize

from mjfish.arrays import FloatArray
from mjfish.diagnose import algebra
from mjfish.diagnose.noise.coloured import Coloured
from mjfish.diagnose.noise.differentiated import DEGREES, WINDOWS, Differentiated
from mjfish.identify import Fit, Noise, Problem
from mjfish.identify.smoothing import Differentiator, LowPass, Smoothing

#: What a filter must explain beyond the coefficients and all candidates: chance of 1e-9 for one parameter more.
_CLEAR = 40.0
#: Orders of Butterworth filters that are tried, and how many cutoffs, from the lowest of interest [Hz] to the samples'.
_ORDERS, _CUTOFFS, _LOWEST = (1, 2, 4), 24, 2.0


def smoothing_of(problem: Problem, fit: Fit, noise: Noise, known: Sequence[FloatArray]) -> Smoothing | None:
    """Return the filter of the recording; None where none is clear.

    Args:
        problem: that was fitted.
        fit: its result.
        noise: that was found.
        known: `mjfish.diagnose.evidence.signatures` of every effect that may explain something.
    """
    if not (tried := _filters(problem, noise)):
        return problem.smoothing
    weigh = _Scale(problem, fit, noise, known)
    left = weigh([None, *tried])
    best = int(np.argmin(left))
    if left[0] - left[best] < _CLEAR:
        return None
    found = tried[best - 1]
    if not isinstance(found, LowPass):
        return found
    log = np.log(found.cutoff)
    cutoff = optimize.minimize_scalar(
        lambda x: float(weigh([replace(found, cutoff=float(np.exp(x)))])[0]),
        bounds=(log - 0.1, min(log + 0.1, float(np.log(_highest(problem))))),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return replace(found, cutoff=float(f"{np.exp(cutoff.x):.3g}"))


class _Scale:
    """What filters leave of the data, once the coefficients and all candidates had their share."""

    def __init__(self, problem: Problem, fit: Fit, noise: Noise, known: Sequence[FloatArray]) -> None:
        self.problem, self.noise = problem, noise
        self._predicted = replace(problem, smoothing=None).predictions(fit.x)
        slopes = problem.sensitivities(fit.x)
        columns = [np.concatenate(parts, axis=2) for parts in zip(slopes, known, strict=True)]
        self._span = algebra.orthonormal(self._whitened(columns))

    def __call__(self, tried: Sequence[Smoothing | None]) -> FloatArray:
        """Return the sums of squares (k,) that are left with each filter."""
        columns = []
        for i, (trial, velocity) in enumerate(zip(self.problem.trials, self._predicted, strict=True)):
            smooth = [velocity if one is None else one.of_trial(trial, velocity) for one in tried]
            columns.append((trial.velocity[:, :, None] - np.stack(smooth, axis=2))[self.problem.mask(i)])
        left = algebra.project_out(self._span, self._whitened(columns))
        return np.asarray(np.sum(left**2, axis=0))

    def _whitened(self, columns: Sequence[FloatArray]) -> FloatArray:
        return replace(self.problem, noise=self.noise).whiten(columns)


def _filters(problem: Problem, noise: Noise) -> list[Smoothing]:
    """Return the filters that the noise may have gone through."""
    if isinstance(noise, Differentiated):
        return [Differentiator(noise.window, noise.degree, turned) for turned in (False, True)]
    if not isinstance(noise, Coloured) or noise.order == 0:
        return []
    cutoffs = np.geomspace(_LOWEST, _highest(problem), _CUTOFFS)
    found: list[Smoothing] = [LowPass(float(cutoff), order) for order in _ORDERS for cutoff in cutoffs]
    found += [
        Differentiator(window, degree, turned)
        for window in WINDOWS
        for degree in DEGREES
        if window > degree
        for turned in (False, True)
    ]
    return found


def _highest(problem: Problem) -> float:
    """Return the highest cutoff [Hz] that all samples resolve."""
    return 0.45 / max(trial.step for trial in problem.trials)
