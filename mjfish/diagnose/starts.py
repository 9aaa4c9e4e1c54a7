"""Where a refit starts from: sizes of the effect that are worth a look, and the best of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnose.evidence import Evidence
from mjfish.effects.effect import Effect
from mjfish.identify import Problem
from mjfish.parameter import Parameter, bounds

#: Sizes of the one-step estimate, and of an amplitude's scale, that a refit starts from.
_MULTIPLES = (0.3, 1.0, 3.0)
#: And of the scale of a cause that is not smooth at its null.
_GRID = (0.1, 0.2, 0.6, 1.25, 1.5, 1.75, 2.0, 2.5)
#: How many of the most promising starts are looked at once more, with the coefficients moved.
_TRIED = 3
#: A refit of an amplitude that cannot be negative keeps this share of its scale away from zero; or of its one-step
#: estimate, where that is smaller.
_OFF_NULL, _OFF_ESTIMATE = 0.02, 0.1


def best_start(evidence: Evidence, problem: Problem, effect: Effect, one_step: Mapping[str, float]) -> FloatArray:
    """Return the best start (p,) for the fit of a model that is extended by an effect.

    The one-step estimate is right for a small effect; a large one may lie outside the reach of its linearisation:
    multiples of it and of the declared scale are tried, with the coefficients where they were; the estimate once more
    with the coefficients moved; and next to nothing of the effect, for no refit need be worse than none.

    The free parameters of the evidence's model move by (J'J)^-1 J' e to where they belong at each start, and what is
    left of e beyond the span of J is what it is judged by: variable projection [GolubPereyra1973] with J at the
    evidence's fit. The most promising are simulated once more.

    Args:
        evidence: of the model that is extended.
        problem: of the extended one.
        effect: the cause that it is extended by.
        one_step: its one-step estimate.

    [GolubPereyra1973] G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10.
    """
    values = evidence.fit.values
    starts = [problem.start({**values, **guess}) for guess in guesses(effect, one_step)]
    starts.append(problem.start({**evidence.refitted(effect.name, one_step), **_inside(effect, one_step)}))
    starts.append(problem.start(values))
    free = [p.name for p, held in zip(evidence.fit.parameters, evidence.fit.at_bound, strict=True) if not held]
    columns = np.array([[p.name for p in problem.parameters].index(name) for name in free], dtype=np.int64)
    jacobian = evidence.fit.jacobian[:, ~evidence.fit.at_bound]
    low, high = bounds(problem.parameters)
    residuals = np.stack([problem.residual(start) for start in starts], axis=1)
    steps = np.linalg.lstsq(jacobian, residuals, rcond=1e-8)[0]
    moved = np.stack(starts)
    moved[:, columns] += steps.T
    moved = np.clip(moved, low, high)
    promised = np.sum((residuals - jacobian @ steps) ** 2, axis=0)
    tried = moved[np.argsort(promised)[:_TRIED]]
    left = [*np.sum(residuals**2, axis=0), *(float(np.sum(problem.residual(x) ** 2)) for x in tried)]
    return np.asarray([*starts, *tried][int(np.argmin(left))])


def guesses(effect: Effect, one_step: Mapping[str, float]) -> list[dict[str, float]]:
    """Return amplitudes that a fit may start from: multiples of the one-step estimate and of the declared scale."""
    amplitudes = [p for p in effect.parameters if not p.shape]
    found = [
        {p.name: p.default + multiple * (one_step[p.name] - p.default) for p in amplitudes} for multiple in _MULTIPLES
    ]
    for multiple in _MULTIPLES:
        signs = {p.name: -1.0 if one_step[p.name] < p.default else 1.0 for p in amplitudes}
        found.append({p.name: p.default + multiple * signs[p.name] * p.scale for p in amplitudes})
    if not effect.smooth and len(amplitudes) == 1:  # an optimum in another valley is out of a fit's reach
        found += [{p.name: p.default + share * p.scale for p in amplitudes} for share in _GRID]
    if any(p.start != p.default for p in amplitudes):  # declared where there is no gradient at the null
        found += [{p.name: p.default + share * (p.start - p.default) for p in amplitudes} for share in (1.0, 2.0)]
    return [_inside(effect, guess) for guess in found]


def _inside(effect: Effect, guess: Mapping[str, float]) -> dict[str, float]:
    return {p.name: float(np.clip(guess[p.name], p.low, p.high)) for p in effect.parameters if not p.shape}


def off_null(effect: Effect, estimates: Mapping[str, float] | None = None) -> dict[str, Parameter]:
    """Keep amplitudes that cannot be negative a little above zero, where they have derivatives on both sides.

    Args:
        effect: whose amplitudes.
        estimates: rough ones that may be smaller than that.
    """
    lifted = {}
    for p in effect.parameters:
        if not p.shape and p.default == p.low:
            small = (estimates or {}).get(p.name, 0.0) - p.low
            off = min(_OFF_NULL * p.scale, _OFF_ESTIMATE * small) if small > 0.0 else _OFF_NULL * p.scale
            lifted[p.name] = p.rebound(low=p.low + off, start=max(p.start, p.low + off))
    return lifted
