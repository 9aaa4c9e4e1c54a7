"""Where a refit starts from: sizes of the effect that are worth a look, and the best of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis.evidence import Evidence
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem
from mjfish.parameter import Parameter, bounds

#: Sizes of the one-step estimate, and of an amplitude's scale, that a refit starts from.
_MULTIPLES = (0.3, 1.0, 3.0)
#: And of the scale of a cause that is not smooth at its null.
_GRID = (0.1, 0.2, 0.6, 1.25, 1.5, 1.75, 2.0, 2.5)
#: Change of the sum of squares from which on a size is felt, and how closely and how far above the least such is tried.
_FELT, _HALVINGS, _ABOVE = 0.5, 8, (0.003, 0.006, 0.012, 0.025, 0.05)
#: Multiples of a fitted amplitude at which another valley is looked for.
_VALLEYS = tuple(2.0 ** (k / 4.0) for k in (-4, -3, -2, -1, 1, 2, 3, 4))
#: How many of the most promising starts are looked at once more, with the coefficients moved.
_TRIED = 3
#: An amplitude that cannot be negative may come nearer to zero than its effect says (`Effect.least`): to this share of
#: the smallest size that would show.
_OFF_VISIBLE = 0.05


def best_start(evidence: Evidence, problem: Problem, effect: Effect) -> FloatArray:
    """Return the best start (p,) for the fit of a model that is extended by an effect.

    The one-step estimate is right for a small effect; a large one may lie outside the reach of its linearisation:
    multiples of it and of the declared scale are tried, with the coefficients where they were; the estimate once more
    with the coefficients moved; and next to nothing of the effect, for no refit need be worse than none. Of a cause
    that is not felt below some size, sizes just above that are tried as well: its valley may be narrow.

    Args:
        evidence: of the model that is extended.
        problem: of the extended one.
        effect: the cause that it is extended by.
    """
    values, one_step = evidence.fit.values, evidence.first_guess(effect.name)
    tried = _Tried(evidence.fit, problem.rough)
    for guess in guesses(effect, one_step):
        tried.add(problem.start({**values, **guess}))
    tried.add(problem.start({**evidence.refitted(effect.name, one_step), **_inside(effect, one_step)}))
    tried.add(problem.start(values))
    amplitudes = evidence.amplitudes_of(effect.name)
    if not effect.smooth and len(amplitudes) == 1:
        to_the_edge(tried, [p.name for p in problem.parameters].index(amplitudes[0].name))
    return tried.best()


class _Tried:
    """Starts, the free parameters of a fit but a fixed one moved to where they belong at each.

    They move by (J'J)^-1 J' e, and what is left of e beyond the span of J is what a start is judged by: variable
    projection [GolubPereyra1973] with J at that fit.

    [GolubPereyra1973] G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10.
    """

    def __init__(self, found: Fit, problem: Problem, fixed: str = "") -> None:
        self.problem = problem
        free = np.array([p.name != fixed for p in found.parameters]) & ~found.at_bound
        names = [p.name for p in problem.parameters]
        self._columns = np.array([names.index(found.parameters[i].name) for i in np.flatnonzero(free)], dtype=np.int64)
        self._jacobian = found.jacobian[:, free]
        self._inverse = np.linalg.pinv(self._jacobian, rcond=1e-8)
        self.starts: list[FloatArray] = []
        self.moved: list[FloatArray] = []
        self.left: list[float] = []
        self.promised: list[float] = []

    def add(self, start: FloatArray) -> float:
        """Try a start (p,); return the sum of squares that is promised there."""
        residual = self.problem.residual(start)
        step = self._inverse @ residual
        moved = start.copy()
        moved[self._columns] += step
        self.starts.append(start)
        self.moved.append(np.clip(moved, *bounds(self.problem.parameters)))
        self.left.append(float(residual @ residual))
        self.promised.append(float(np.sum((residual - self._jacobian @ step) ** 2)))
        return self.promised[-1]

    def best(self) -> FloatArray:
        """Return the start of the least sum of squares, the most promising ones simulated where they moved to."""
        promising = [self.moved[i] for i in np.argsort(self.promised)[:_TRIED]]
        left = [*self.left, *(float(np.sum(self.problem.residual(x) ** 2)) for x in promising)]
        return np.asarray([*self.starts, *promising][int(np.argmin(left))])


def other_valleys(found: Fit, problem: Problem, *, fits: bool = True) -> list[FloatArray]:
    """Return, per amplitude that is not smooth at its null, where another explains more than the fit does.

    Along such an amplitude the sum of squares has several valleys, of a tail that rings by less than an octave apart:
    sizes from half to twice are tried, the other free parameters moved along.

    Args:
        found: where a fit has ended.
        problem: its problem.
        fits: False: it leaves something systematic, and the best other valley is worth a look though it seems higher.
    """
    rough = [p.name for effect in problem.model.effects if not effect.smooth for p in effect.parameters if not p.shape]
    better = []
    for column, p in enumerate(problem.parameters):
        if p.name in rough:
            tried = _Tried(found, problem, p.name)
            for multiple in _VALLEYS:
                start = found.x.copy()
                start[column] = np.clip(multiple * found.x[column], p.low, p.high)
                tried.add(start)
            there = tried.best()
            if float(np.sum(problem.residual(there) ** 2)) < found.sse:
                better.append(there)
            elif not fits and (valley := _valley(tried.promised, found.sse)) is not None:
                better.append(tried.moved[valley])
    return better


def _valley(promised: Sequence[float], here: float) -> int | None:
    """Return which of `_VALLEYS` is the floor of the best valley but that where the fit is; None: there is no other."""
    below = sum(multiple < 1.0 for multiple in _VALLEYS)
    sums = [np.inf, *promised[:below], here, *promised[below:], np.inf]
    floors = [k for k in range(1, len(sums) - 1) if sums[k] < min(sums[k - 1], sums[k + 1]) and k != below + 1]
    lowest = min(floors, key=lambda k: sums[k], default=None)
    if lowest is None:
        return None
    return lowest - 1 if lowest <= below else lowest - 2


def to_the_edge(tried: _Tried, column: int) -> None:
    """Find by bisection from which size on the amplitude of a column is felt, if not at any; try some just above.

    Felt is what differs from next to nothing, not from nothing: an effect that is there and idle passes the motion
    through another computation, whose rounding sharp noise may show.
    """
    sizes, promised = np.array([start[column] for start in tried.starts]), np.array(tried.promised)
    least = int(np.argmin(np.where(sizes > sizes.min(), sizes, np.inf)))
    idle = float(promised[least])
    felt = np.abs(promised - idle) > _FELT
    if felt.all() or not np.any(felt & (sizes > sizes[~felt].max())):
        return
    start = tried.starts[int(np.argmax(np.where(felt, -np.inf, sizes)))]
    low, high = float(start[column]), float(sizes[felt & (sizes > start[column])].min())

    def at(size: float) -> float:
        x = start.copy()
        x[column] = size
        return tried.add(x)

    if abs(at(0.5 * float(sizes[least])) - idle) > _FELT:
        return  # felt at any size: there is no edge
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if abs(at(middle) - idle) > _FELT:
            high = middle
        else:
            low = middle
    for share in _ABOVE:
        at((1.0 + share) * high)


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


def off_null(effect: Effect, visible: Mapping[str, float] | None = None) -> dict[str, Parameter]:
    """Keep amplitudes that cannot be negative a little above zero, where they have derivatives on both sides.

    Args:
        effect: whose amplitudes.
        visible: the smallest sizes that would show, where that can be said: nothing to be seen may be cut off.
    """
    lifted = {}
    for p in effect.parameters:
        if not p.shape and p.default == p.low:
            off = min(effect.least * p.scale, _OFF_VISIBLE * (visible or {}).get(p.name, np.inf))
            lifted[p.name] = p.rebound(low=p.low + off, start=max(p.start, p.low + off))
    return lifted
