"""Noisier ends of runs: a differentiating filter has less to go on there, and its errors are several times larger.

Where the squared residual grows towards the first and towards the last samples of the runs by more than chance, pooled
over runs and channels, as many samples are left out at either end. A filter does to both ends alike; what grows towards
one of them alone, as near a wall that the runs end at, is no noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray, robust_sigma

#: Longest end that is looked at, samples.
_LONGEST = 20
#: Chance at which the outermost two samples of either end must be too large, and the others for it to reach there.
_ALARM, _REACH = 1e-4, 1e-2


def noisy_ends(residuals: Sequence[FloatArray]) -> int:
    """Return how many samples at either end of every run are noisier than the rest.

    Args:
        residuals: (n_r, 3) of every run, less what any cause explains.
    """
    sigma = robust_sigma(np.concatenate(residuals)) + 1e-300
    first, last = (_squares([(r / sigma)[::turn] for r in residuals]) for turn in (1, -1))
    count = 3 * len(residuals)
    if min(first[:2].mean(), last[:2].mean()) < stats.chi2.isf(_ALARM, 2 * count) / (2 * count):
        return 0
    quiet = np.flatnonzero(0.5 * (first + last) < stats.chi2.isf(_REACH, 2 * count) / (2 * count))
    return int(quiet[0]) if len(quiet) else _LONGEST


def _squares(scaled: Sequence[FloatArray]) -> FloatArray:
    """Return the mean squares (_LONGEST,) of the first samples, over runs and channels."""
    first = [np.pad(one[:_LONGEST], ((0, max(_LONGEST - len(one), 0)), (0, 0))) for one in scaled]
    return np.asarray(np.mean(np.stack(first) ** 2, axis=(0, 2)))
