"""One run that the others do not go with: its misfit, where the coefficients were fitted without it, against theirs.

Leaving run r out moves the estimates by one Gauss-Newton step, x_-r = x + (J_-r' J_-r)^-1 J_-r' e_-r, and the residuals
with them. No fit is run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.inspection.finding import Finding

#: A whitened residual counts as this many sigma at most: one far sample makes no bad run.
_CAP = 4.0
#: How many times worse than a run of the same drive, over the stretch they share, an odd run is.
_SUSPECT = 4.0
#: How many times worse than the next worst run an odd run is that no other run can be compared with.
_REMARK = 5.0
#: Samples over which two runs of one drive are compared at least.
_FEWEST = 30


def odd_run(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Find a run that is far worse than the rest."""
    trials = problem.trials
    if len(trials) < 3:
        return
    blocks = _by_trial(problem, fit)
    worst = int(np.argmax([_size(_without(blocks, fit, r)[r]) for r in range(len(trials))]))
    residuals = _without(blocks, fit, worst)
    level = np.array([_size(one) for one in residuals])
    twins = [(_shared(problem, residuals, worst, k), k) for k in range(len(trials)) if k != worst]
    compared = [(ratio, k) for ratio, k in twins if ratio is not None]
    if compared:
        ratio, twin = min(compared)
        if ratio > _SUSPECT:
            yield Finding(
                "odd_run",
                "suspect",
                f"trial '{trials[worst].name}'",
                f"its misfit is {ratio:.0f} times that of '{trials[twin].name}' under the same drive, with the "
                "coefficients fitted without it",
                "runs of one drive to be alike but for noise",
                "look at this run: another clock, scale, charge of the battery, or something in its way; diagnose "
                "without it",
                trials=(trials[worst].name,),
            )
        return
    others = np.delete(level, worst)
    if level[worst] > _REMARK * others.max():
        yield Finding(
            "odd_run",
            "remark",
            f"trial '{trials[worst].name}'",
            f"its misfit per sample is {level[worst] / np.median(others):.0f} times that of the other runs, with the "
            "coefficients fitted without it; no other run has its drive",
            "misfits of one size",
            "repeat this run: alone, it cannot be told from a cause that shows only under its drive",
            trials=(trials[worst].name,),
        )


def _by_trial(problem: Problem, fit: Fit) -> list[tuple[FloatArray, FloatArray]]:
    """Return whitened residual (m, 3) and Jacobian (m, 3, p) of every trial."""
    found, row = [], 0
    for i in range(len(problem.trials)):
        counted = int(np.count_nonzero(problem.mask(i)))
        rows = slice(row, row + problem.whitened(i, np.zeros((counted, 3))).size)
        row = rows.stop
        found.append((fit.residual[rows].reshape(-1, 3), fit.jacobian[rows].reshape(-1, 3, fit.jacobian.shape[1])))
    return found


def _without(blocks: Sequence[tuple[FloatArray, FloatArray]], fit: Fit, r: int) -> list[FloatArray]:
    """Return the residuals (m, 3) of all runs at the estimates without run r."""
    free = np.flatnonzero(~fit.at_bound)
    design = np.concatenate([j[:, :, free].reshape(e.size, len(free)) for k, (e, j) in enumerate(blocks) if k != r])
    left = np.concatenate([e.ravel() for k, (e, _) in enumerate(blocks) if k != r])
    # A direction that the other runs do not see is not moved.
    step = np.linalg.lstsq(design, left, rcond=1e-6)[0]
    return [np.asarray(e - j[:, :, free] @ step) for e, j in blocks]


def _size(residual: FloatArray) -> float:
    return float(np.mean(np.minimum(residual**2, _CAP**2)))


def _shared(problem: Problem, residuals: Sequence[FloatArray], worst: int, other: int) -> float | None:
    """Return how many times worse `worst` is than `other` while both had one drive; None where they never had."""
    until = _alike(problem.trials[worst], problem.trials[other])
    if until is None:
        return None
    here = [residuals[k][_times(problem, k, len(residuals[k])) < until] for k in (worst, other)]
    if min(len(part) for part in here) < _FEWEST:
        return None
    return _uncapped(here[0]) / max(_uncapped(here[1]), 1e-12)


def _uncapped(residual: FloatArray) -> float:
    """Mean square without the largest two per cent."""
    squares = np.sort((residual**2).ravel())
    return float(np.mean(squares[: max(int(0.98 * len(squares)), 1)]))


def _times(problem: Problem, index: int, rows: int) -> FloatArray:
    """Return the times (rows,) of the whitened rows of a trial; with gaps the first of each stretch are not counted."""
    time = problem.trials[index].time[problem.mask(index)]
    return np.asarray(time[len(time) - rows :])


def _alike(a: Trial, b: Trial) -> float | None:
    """Return until when two runs have the same drive from the start [s]; None where they differ at once."""
    if not a.drive or not b.drive or a.drive[0] != b.drive[0]:
        return None
    ends = [one.drive[1].start if len(one.drive) > 1 else float(one.time[-1]) for one in (a, b)]
    return float(a.time[-1]) if a.drive == b.drive else min(ends)
