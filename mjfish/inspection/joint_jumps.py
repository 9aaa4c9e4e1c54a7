"""Measured joint angles that jump: at a start, or where the drive changes at once.

They move faster than their samples resolve. The motion between samples is a spline (`mjfish.drive.measured`). It is
right where every sample follows from those beside it. Each one is predicted by the polynomial through its six
neighbours, three to either side; of a beat with ten samples or more, that leaves less than the noise does. Where an
angle or its rate jumps, the error stands far above.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from mjfish.data import Trial, columns
from mjfish.data.validation import beats
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import FloatArray, robust_sigma

#: Neighbours to either side, the degree of the polynomial and one, halved.
_REACH = 3
_OFFSETS = np.array([k for k in range(-_REACH, _REACH + 1) if k != 0])
#: A jump leaves more than this many sigma, of which normal noise leaves none, and this share of the joint's range.
_FAR, _SMALL = 7.0, 0.01
#: Rows beside a jump that its angles reach.
_BESIDE = 2
#: Fewest samples of which a standard deviation is taken.
_FEWEST = 8 * _REACH
#: Where it happens oftener than once in so many beats it belongs to the beat, and no cut removes it.
_BEATS = 2.0


@dataclass(frozen=True)
class Jump:
    """Where a measured joint moves faster than its samples resolve.

    Attributes:
        first, last: rows that do not follow from those beside them.
        joint: where that is clearest, from 0.
        error: of the worst of these samples [rad].
        sigma: how many standard deviations of the trial's other samples that is.
    """

    first: int
    last: int
    joint: int
    error: float
    sigma: float


def jumps(trial: Trial) -> list[Jump]:
    """Return the jumps of measured joint angles; none where they belong to every beat."""
    angle = trial.joint_angle
    if angle is None or trial.commanded or len(angle) < _FEWEST:
        return []
    error = np.abs(_left_out(trial.time, angle))
    sigma = robust_sigma(error) + 1e-300
    rows = np.flatnonzero(np.any(error > np.maximum(_FAR * sigma, _SMALL * np.ptp(angle, axis=0)), axis=1))
    found = []
    for cluster in filter(len, np.split(rows, np.flatnonzero(np.diff(rows) > 2 * _REACH) + 1)):
        worst, joint = np.unravel_index(np.argmax(error[cluster] / sigma), (len(cluster), angle.shape[1]))
        size = float(error[cluster[worst], joint])
        first, last = (int(cluster[k]) + _REACH for k in (0, -1))
        found.append(Jump(first, last, int(joint), size, size / float(sigma[joint])))
    count = float(np.ptp(trial.time)) * min(beats(trial), default=0.0)
    return found if len(found) <= max(count / _BEATS, 1.0) else []


def unresolved(trial: Trial) -> Iterator[Finding]:
    """Yield where measured joint angles jump: the motion between the samples, and the force on them, are unknown."""
    found = jumps(trial)
    if not found:
        return
    worst = max(found, key=lambda jump: jump.sigma)
    time, joint = trial.time, columns.joint(worst.joint + 1)
    when = " and ".join(f"{0.5 * (time[jump.first] + time[jump.last]):.3g} s" for jump in found)
    yield Finding(
        "joints-unresolved",
        "suspect",
        f"trial '{trial.name}', {joint}, near {when}",
        f"an angle is {worst.error:.2g} rad ({worst.sigma:.0f} sigma) off the line through its neighbours: the joint "
        f"moves faster than a sample every {trial.step:.3g} s resolves, or the sample was misread",
        "angles that follow from the samples beside them",
        f"cut the run there: keep {_kept(trial, found)}; or record the joint angles faster, or give the drive in place "
        "of the angles",
        trials=(trial.name,),
        channels=(joint,),
    )


def _kept(trial: Trial, found: Sequence[Jump]) -> str:
    """Return the times of the rows between the jumps, where they last a beat."""
    time = trial.time
    least = 1.0 / min(beats(trial), default=np.inf)
    # The beat after a jump is left out: the start of a run is fitted, and must not lie on angles that are in doubt.
    after = max(_BESIDE, round(least / trial.step))
    starts = [0, *(min(jump.last + after, len(time) - 1) for jump in found)]
    ends = [*(max(jump.first - _BESIDE, 0) for jump in found), len(time) - 1]
    parts = [(float(time[a]), float(time[b])) for a, b in zip(starts, ends, strict=True)]
    long = [f"{a:.4g} to {b:.4g} s" for a, b in parts if b - a > least]
    more = ", each as a run of its own" if len(long) > 1 else ""
    return (
        f"its rows from {' and from '.join(long)}{more}" if long else "the parts before and after, if they last a beat"
    )


def _left_out(time: FloatArray, angle: FloatArray) -> FloatArray:
    """Return samples (n - 6, joints) less the polynomial through their six neighbours."""
    rows = np.arange(_REACH, len(time) - _REACH)
    near = time[rows[:, None] + _OFFSETS]
    weights = np.ones_like(near)
    for m, q in permutations(range(len(_OFFSETS)), 2):
        weights[:, m] *= (time[rows] - near[:, q]) / (near[:, m] - near[:, q])
    return np.asarray(angle[rows] - np.einsum("km,kmj->kj", weights, angle[rows[:, None] + _OFFSETS]))
