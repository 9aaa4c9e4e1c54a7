"""Whether the motion went through the filter that the noise went through: by what predictions explain that do, too.

Velocities that are not white in their noise were differentiated, smoothed, or both, and the motion with them. The noise
may have come in later all the same; so each filter is tried on the prediction, and taken where the data are clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.effects import Effect
from mjfish.estimation import Fit, Noise, Problem, algebra
from mjfish.estimation.smoothing import Differentiator
from mjfish.noise.coloured import Coloured
from mjfish.noise.differentiated import DEGREES, WINDOWS, Differentiated

#: What a filter must explain beyond the coefficients and all candidates: chance of 1e-9 for one parameter more.
_CLEAR = 40.0


def smoothing_of(
    problem: Problem, fit: Fit, noise: Noise, others: Sequence[Effect], known: Sequence[FloatArray]
) -> Differentiator | None:
    """Return the filter of the recording; None where none is clear.

    It must explain what coefficients and candidates together do not, and more than any candidate alone would: what a
    strong cause has beyond first order looks like many things.

    Args:
        problem: that was fitted, with the leading cause where there is one.
        fit: its result.
        noise: that was found there.
        others: effects that may explain something and are not in the model.
        known: their `mjfish.diagnosis.evidence.signatures`.
    """
    shortest = min(len(trial.time) for trial in problem.trials)
    if not (tried := [one for one in _filters(noise) if one.window < shortest]):
        return problem.smoothing
    weighed = replace(problem, noise=noise)
    predicted = replace(problem, smoothing=None).predictions(fit.x)
    columns = []
    for i, (trial, velocity) in enumerate(zip(problem.trials, predicted, strict=True)):
        smooth = [velocity, *(one.of_trial(trial, velocity) for one in tried)]
        columns.append((trial.velocity[:, :, None] - np.stack(smooth, axis=2))[problem.mask(i)])
    span = algebra.orthonormal(weighed.whiten(problem.sensitivities(fit.x)))
    left = algebra.project_out(span, weighed.whiten(columns))
    signs = algebra.project_out(span, weighed.whiten(known))
    alone = np.sum(left**2, axis=0)
    beside = np.sum(algebra.project_out(algebra.orthonormal(signs), left) ** 2, axis=0)
    best = 1 + int(np.argmin(beside[1:]))
    sizes = [sum(not p.shape for p in effect.parameters) for effect in others]
    spans = [algebra.orthonormal(signs[:, block]) for block in algebra.blocks_of(sizes)]
    rival = max((float(np.sum((one.T @ left[:, 0]) ** 2)) for one in spans), default=0.0)
    clear = beside[0] - beside[best] > _CLEAR and alone[0] - alone[best] > rival
    return tried[best - 1] if clear else None


def _filters(noise: Noise) -> list[Differentiator]:
    """Return the filters that the noise may have gone through."""
    if isinstance(noise, Differentiated):
        return [Differentiator(noise.window, noise.degree, turned) for turned in (False, True)]
    if not isinstance(noise, Coloured) or noise.order == 0:
        return []
    return [
        Differentiator(window, degree, turned)
        for window in WINDOWS
        for degree in DEGREES
        if window > degree
        for turned in (False, True)
    ]
