"""Noisier ends of runs: a differentiating filter has less to go on there, and its errors are several times larger.

Physics has no reason to fail at the last samples of a run; where the squared residual grows towards the end of the runs
by more than chance, pooled over runs and channels, as many samples are left out at either end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray, robust_sigma

#: Longest end that is looked at, samples.
_LONGEST = 20
#: Chance at which the very last samples must be too large, and the others for the end to reach there.
_ALARM, _REACH = 1e-4, 1e-2


def noisy_ends(residuals: Sequence[FloatArray]) -> int:
    """Return how many samples at the end of every run are noisier than the rest.

    Args:
        residuals: (n_r, 3) of every run, less what any cause explains.
    """
    sigma = robust_sigma(np.concatenate(residuals)) + 1e-300
    last = np.stack([np.pad(r / sigma, ((_LONGEST, 0), (0, 0)))[: -_LONGEST - 1 : -1] for r in residuals])
    square = np.mean(last**2, axis=(0, 2))
    count = 3 * len(residuals)
    if square[:2].mean() < stats.chi2.isf(_ALARM, 2 * count) / (2 * count):
        return 0
    quiet = np.flatnonzero(square < stats.chi2.isf(_REACH, count) / count)
    return int(quiet[0]) if len(quiet) else _LONGEST
