"""How far each sample is from a smooth line through its neighbours, without a model of the fish.

Each channel of a trial is interpolated from the samples beside it by the weights that do so best in that trial (least
squares, with Huber weights, so that outliers do not pull): periodic swimming is predicted exactly, noise is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjfish.arrays import FloatArray, robust_sigma
from mjfish.data import Trial
from mjfish.data.check import GAP

#: Neighbours to either side: as many as an odd and an even harmonic or two need, twice.
_REACH = 5
_ROUNDS = 5
#: After a start or a step of the drive, beats that are left out.
_BEATS = 2.5
_HUBER = 1.5


@dataclass(frozen=True, eq=False)
class Smooth:
    """Misfit of the samples of one trial to a smooth line.

    Attributes:
        trial: the trial.
        rows: (m,) samples that have all their neighbours.
        misfit: (m, 3) sample minus line; of white noise sigma, it has sigma sqrt(1 + |weights|^2).
        sigma: (3,) robust standard deviation of `misfit`.
        noise: (3,) the white noise that explains it.
    """

    trial: Trial
    rows: NDArray[np.intp]
    misfit: FloatArray
    sigma: FloatArray
    noise: FloatArray


def smooth(trial: Trial) -> Smooth | None:
    """Interpolate every sample from its neighbours; None where too few samples have all of theirs."""
    time = trial.time
    step = float(np.median(np.diff(time)))
    torn = np.diff(time) > GAP * step
    for segment in trial.drive:  # what the fish does in its first beats is not periodic
        settling = segment.start + _BEATS * 2.0 * np.pi / segment.omega
        torn |= (time[1:] >= segment.start - step) & (time[:-1] <= settling)
    before = np.concatenate([[0], np.cumsum(torn)])
    rows = np.arange(_REACH, len(time) - _REACH)
    rows = rows[before[rows + _REACH] == before[rows - _REACH]]
    if len(rows) < 8 * _REACH:
        return None
    offsets = np.array([k for k in range(-_REACH, _REACH + 1) if k != 0])
    misfit, noise = np.empty((len(rows), 3)), np.empty(3)
    for channel in range(3):
        values = trial.velocity[:, channel] - np.median(trial.velocity[:, channel])
        design = np.column_stack([values[rows[:, None] + offsets], np.ones(len(rows))])
        misfit[:, channel], weights = _robust(design, values[rows])
        noise[channel] = 1.0 / np.sqrt(1.0 + weights[:-1] @ weights[:-1])
    sigma = robust_sigma(misfit) + 1e-300
    return Smooth(trial, rows, misfit, sigma, sigma * noise)


def pooled(found: Sequence[Smooth]) -> FloatArray:
    """Return the noise (3,) of all trials, the median."""
    return np.asarray(np.median([one.noise for one in found], axis=0)) if found else np.zeros(3)


def _robust(design: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals and coefficients of a Huber fit."""
    weight = np.ones(len(target))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(design * root[:, None], target * root)[0]
        residual = target - design @ coefficients
        scale = _HUBER * float(robust_sigma(residual)) + 1e-300
        weight = np.minimum(scale / np.maximum(np.abs(residual), 1e-300), 1.0)
    return np.asarray(residual), np.asarray(coefficients)
