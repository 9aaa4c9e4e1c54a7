"""Spectra of residuals: periodograms of all trials, averaged in bands, for Whittle's likelihood.

[Whittle1953] P. Whittle, The analysis of multiple stationary time series, J. R. Statist. Soc. B 15.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import signal

from mjfish.arrays import BoolArray, FloatArray
from mjfish.estimation import Problem
from mjfish.noise.coloured import grid

#: Highest frequency, as a share of the sampling rate.
_HIGHEST = 0.45
#: Bands of frequency in which periodograms are averaged.
_BANDS = 40


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Mean periodograms in bands: middle [Hz] (b,), power (b, 3, 3), how many went into each (b,)."""

    frequency: FloatArray
    power: Any
    count: FloatArray


def spectrum(problem: Problem, residuals: Sequence[FloatArray]) -> Spectrum:
    """Return the spectrum of residuals (n_r, 3) of the trials of a problem, two-sided, per Hz."""
    step = problem.trials[0].step
    return _binned(
        [
            _periodogram(block, grid(trial.time, problem.mask(i)), step)
            for i, (trial, block) in enumerate(zip(problem.trials, residuals, strict=True))
        ]
    )


def _periodogram(block: FloatArray, seen: BoolArray, step: float) -> tuple[FloatArray, Any]:
    """Return frequencies (f,) [Hz] and cross-periodograms (f, 3, 3) of a tapered series; gaps count as zero."""
    filled = np.zeros((len(seen), 3))
    filled[seen] = block
    window = signal.windows.hann(len(seen), sym=False) * seen
    waves = np.fft.rfft(filled * window[:, None], axis=0)
    power = np.einsum("fi,fj->fij", waves, waves.conj()) * step / np.sum(window**2)
    frequency = np.asarray(np.fft.rfftfreq(len(seen), step), dtype=np.float64)
    kept = (frequency > 0.0) & (frequency < _HIGHEST / step)
    return frequency[kept], power[kept]


def _binned(spectra: Sequence[tuple[FloatArray, Any]]) -> Spectrum:
    """Average periodograms of all trials in bands that widen with frequency."""
    frequency = np.concatenate([f for f, _ in spectra])
    power = np.concatenate([p for _, p in spectra])
    edges = np.geomspace(frequency.min() * 0.99, frequency.max() * 1.01, _BANDS + 1)
    band = np.digitize(frequency, edges) - 1
    used = np.unique(band)
    return Spectrum(
        np.array([frequency[band == b].mean() for b in used]),
        np.stack([power[band == b].mean(axis=0) for b in used]),
        np.array([float(np.count_nonzero(band == b)) for b in used]),
    )
