"""Recordings that are there twice, whole or in part: noise never repeats itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.inspection.finding import EVERYTHING, Finding

#: Blocks of so many rows in a row, and how many of them two trials may share to the last bit by chance: rows alone are
#: shared by runs of one drive that were rounded.
_BLOCK = 4
_SHARED = 3
#: Data whose noise is below this share of their range in every channel are simulated, or smoothed until none is left.
_SILENT = 2e-4
#: Two repeats differ by sqrt(2) sigma; a copy that was rounded or resaved, by less than this many sigma.
_NEAR = 0.3
#: Least share of the shorter of the two that must overlap.
_OVERLAP = 0.25


def copies(trials: Sequence[Trial], held: Sequence[str], sigma: FloatArray) -> Iterator[Finding]:
    """Find pairs of trials that share rows, or that are closer than their own noise.

    Args:
        trials: of the dataset.
        held: names of those held out.
        sigma: (3,) noise that a smooth line through single recordings leaves (`mjfish.inspection.smooth`).
    """
    if not trials:
        return
    blocks = [_blocks(trial) for trial in trials]
    ranges = np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0)
    silent = bool(np.all(sigma < _SILENT * ranges))
    for (i, a), (j, b) in combinations(enumerate(trials), 2):
        blocks_shared = len(blocks[i] & blocks[j])
        shared = blocks_shared + _BLOCK - 1
        close = blocks_shared < _SHARED and not silent and _close(a, b, sigma)
        if blocks_shared < _SHARED and not close:
            continue
        leak = (a.name in held) != (b.name in held)
        share = min(shared / min(len(a.time), len(b.time)), 1.0)
        what = "are the same but for less than their noise" if close else f"share {shared} rows ({share:.0%}) exactly"
        if silent:
            yield Finding(
                "copies",
                "remark",
                f"trials '{a.name}' and '{b.name}'",
                f"{what}, in data without noise",
                "noise, that never repeats itself",
                "simulated data: nothing to do; measured data: remove one of the two",
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


def _blocks(trial: Trial) -> set[bytes]:
    """Return every four rows that follow each other, but those at rest."""
    values = trial.velocity + 0.0  # minus zero is zero
    moving = np.any(values != 0.0, axis=1)
    starts = range(len(values) - _BLOCK + 1)
    return {values[k : k + _BLOCK].tobytes() for k in starts if moving[k : k + _BLOCK].all()}


def _close(a: Trial, b: Trial, sigma: FloatArray) -> bool:
    """Whether two recordings, one shifted to where they agree best, differ by less than noise can."""
    one, other = a.velocity / sigma, b.velocity / sigma
    lag, overlap = _nearest(one, other)
    left, right = one[max(lag, 0) :][:overlap], other[max(-lag, 0) :][:overlap]
    return overlap > 0 and bool(np.median(np.abs(left - right), axis=0).max() < _NEAR)


def _nearest(one: FloatArray, other: FloatArray) -> tuple[int, int]:
    """Return by how many rows the first is ahead where the mean square of the difference is least, and the overlap.

    Sum (a - b)^2 over what overlaps = sums of squares, which grow with the overlap, less twice the correlation.
    """
    n, m = len(one), len(other)
    length = n + m
    spectrum = np.fft.rfft(one, length, axis=0) * np.conj(np.fft.rfft(other, length, axis=0))
    lags = np.arange(-(m - 1), n)
    correlation = np.fft.irfft(spectrum.sum(axis=1), length)[lags]
    start, stop = np.maximum(lags, 0), np.minimum(lags + m, n)
    squares, others = (np.concatenate([[0.0], np.cumsum(np.sum(x**2, axis=1))]) for x in (one, other))
    power = squares[stop] - squares[start] + others[stop - lags] - others[start - lags]
    overlap = stop - start
    wide = overlap >= _OVERLAP * min(n, m)
    best = int(np.argmin(np.where(wide, (power - 2.0 * correlation) / overlap, np.inf)))
    return int(lags[best]), int(overlap[best])
