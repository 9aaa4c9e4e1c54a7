"""Recordings that are there twice, whole or in part: noise never repeats itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.checks.finding import EVERYTHING, Finding
from mjfish.trial import Trial

#: Rows (surge, sway, yaw rate) shared to the last bit, that are no chance.
_SHARED = 5
#: Two repeats differ by sqrt(2) sigma; a copy that was rounded or resaved, by less than this many sigma.
_NEAR = 0.3


def copies(trials: Sequence[Trial], held: Sequence[str], sigma: FloatArray) -> Iterator[Finding]:
    """Find pairs of trials that share rows, or that are closer than their own noise.

    Args:
        trials: of the dataset.
        held: names of those held out.
        sigma: (3,) noise that a smooth line through single recordings leaves (`mjfish.checks.smooth`).
    """
    rows = [{row.tobytes() for row in np.ascontiguousarray(trial.velocity)} for trial in trials]
    ranges = np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0)
    silent = bool(np.all(sigma < 1e-4 * ranges))
    for (i, a), (j, b) in combinations(enumerate(trials), 2):
        moving = np.zeros(3).tobytes()
        shared = len((rows[i] & rows[j]) - {moving})
        close = shared < _SHARED and not silent and _close(a, b, sigma)
        if shared < _SHARED and not close:
            continue
        leak = (a.name in held) != (b.name in held)
        share = shared / min(len(rows[i]), len(rows[j]))
        what = "are the same but for less than their noise" if close else f"share {shared} rows ({share:.0%}) exactly"
        if silent:
            yield Finding(
                "copies",
                "remark",
                f"trials '{a.name}' and '{b.name}'",
                f"{what}, in data without noise",
                "noise, that never repeats itself",
                "simulated data: nothing to do; measured data: look for how they were smoothed",
                trials=(a.name, b.name),
            )
            continue
        consequence = "one is fitted and the other held out, so that the gain is no gain" if leak else "it counts twice"
        yield Finding(
            "copies",
            "blocks" if leak else "suspect",
            f"trials '{a.name}' and '{b.name}'",
            f"they {what}; {consequence}",
            "recordings of their own, with noise of their own",
            "remove one of the two, or cut the part that they share",
            cannot_tell=(EVERYTHING,) if leak else (),
            trials=(a.name, b.name),
        )


def _close(a: Trial, b: Trial, sigma: FloatArray) -> bool:
    """Whether two recordings, one shifted to where they agree best, differ by less than noise can."""
    n = min(len(a.velocity), len(b.velocity))
    one, other = a.velocity[:n] / sigma, b.velocity[:n] / sigma
    length = 2 * n
    spectrum = np.fft.rfft(one, length, axis=0) * np.conj(np.fft.rfft(other, length, axis=0))
    lag = int(np.argmax(np.fft.irfft(spectrum.sum(axis=1), length)))
    lag = lag - length if lag >= n else lag
    overlap = n - abs(lag)
    if overlap < n // 4:
        return False
    left, right = one[max(lag, 0) : max(lag, 0) + overlap], other[max(-lag, 0) : max(-lag, 0) + overlap]
    return bool(np.median(np.abs(left - right), axis=0).max() < _NEAR)
