"""Jumps and drift of a run's clock against its command: frames that were lost, or counted twice, and not marked.

The measured run is held against the simulated one shifted by whole samples; the shift may be constant, change once, or
drift. Lost frames make it change once by as many samples as were lost, which no force does.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.inspection.finding import Finding

#: Shifts that are tried, in samples; a CPG goes on for a quarter of a second behind the last sample.
SHIFTS = np.arange(-6, 13)
#: A changing shift must leave less than this share of the misfit that a constant one leaves.
SHARE = 0.6
#: A run whose mean square, all three channels together, is below this one in units of sigma is on time.
_FITS = 4.0
#: Share of the samples that must lie to either side of a jump.
_SIDE = 0.08


def clock(trial: Trial, shifted: FloatArray, sigma: FloatArray) -> Iterator[Finding]:
    """Find a jump or a drift of the clock.

    Args:
        trial: driven by a CPG.
        shifted: (shifts, n, 3) simulated at trial.time + `SHIFTS` times the sampling interval.
        sigma: (3,) that misfits are divided by.
    """
    misfit = np.sum(((trial.velocity - shifted) / sigma) ** 2, axis=2)
    total = misfit.sum(axis=1)
    n = misfit.shape[1]
    side = max(int(_SIDE * n), 10)
    if n < 4 * side or not np.all(np.isfinite(total)) or total.min() < _FITS * n:
        return
    before = np.cumsum(misfit, axis=1)[:, side : n - side]
    after = total[:, None] - before
    joined = before.min(axis=0) + after.min(axis=0)
    at = int(np.argmin(joined))
    first, second = int(np.argmin(before[:, at])), int(np.argmin(after[:, at]))
    jump = int(SHIFTS[second] - SHIFTS[first])
    constant = float(total.min())
    drifting, ends = _drift(misfit)
    if min(float(joined[at]), drifting) > SHARE * constant:
        return
    step = trial.step
    when = float(trial.time[side + at])
    if drifting < joined[at]:
        share = (SHIFTS[ends[1]] - SHIFTS[ends[0]]) * step / float(np.ptp(trial.time))
        yield Finding(
            "clock",
            "suspect",
            f"trial '{trial.name}', time",
            f"the run's clock drifts against the command by {share:+.2%}",
            "one clock, or two at the same rate",
            "correct the frame rate, or the frequency of the drive",
            cannot_tell=("time_offset", "servo_lag"),
            trials=(trial.name,),
        )
    elif jump:
        what = f"{jump} frames were lost" if jump > 0 else f"{-jump} frames were counted twice"
        yield Finding(
            "clock",
            "blocks" if abs(jump) > 1 else "suspect",
            f"trial '{trial.name}', time {when:.2f} s",
            f"about {what} there: from then on the run is {abs(jump) * step:.3f} s "
            f"{'ahead of' if jump > 0 else 'behind'} its command",
            "times that go on evenly with the command",
            "number the frames by their time stamps and say gaps = true, or cut the run there",
            cannot_tell=("time_offset", "servo_lag"),
            trials=(trial.name,),
        )


def _drift(misfit: FloatArray) -> tuple[float, tuple[int, int]]:
    """Return the least misfit with a shift that goes evenly from one to another, and the two (indices)."""
    shifts, n = misfit.shape
    share = np.linspace(0.0, 1.0, n)
    best, ends = np.inf, (0, 0)
    for a in range(shifts):
        for b in range(shifts):
            if abs(a - b) < 2:
                continue
            at = np.rint(a + (b - a) * share).astype(np.intp)
            here = float(misfit[at, np.arange(n)].sum())
            if here < best:
                best, ends = here, (a, b)
    return best, ends
