"""Noise and smoothness that maximise the evidence of a fit, see `mjfish.data.importers.smooth.batch`."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data.importers.smooth.basis import Basis
from mjfish.data.importers.smooth.observation import IntArray
from mjfish.data.importers.smooth.system import State, System

#: An intensity is believed to be `_LOW` of what it starts from, as much as so many known coefficients say, and stays
#: between two shares of it: at the lower end a parabola and harmonics are left.
_HELD, _LOW, _LEAST, _MOST = 0.01, 1e-4, 1e-8, 1.0
#: Longest step, in steps of expectation maximisation.
_LONGEST = 5.0
#: Settled is what moves by less than this share.
_SETTLED = 0.02


def first_intensity(start: FloatArray, kinds: IntArray, beat: float | None) -> FloatArray:
    """Return intensities (coordinates,) of a motion as rough as a tenth of the range at twice the beat."""
    omega = 2.0 * np.pi * 2.0 * (beat or 1.0)
    line = np.linspace(start[0], start[-1], len(start))
    rough = np.square((0.1 * np.ptp(start - line, axis=0) + 1e-3) * omega**3) / omega
    return np.asarray([rough[kinds == kind].mean() for kind in kinds])


def noise(system: System, covariance: FloatArray, weight: FloatArray, state: State) -> FloatArray:
    """Return the noise of the points (points,) that maximises the evidence."""
    by_frame = _by_frame(system, covariance, *state.coefficients.shape)
    slopes = np.concatenate([system.own, system.shared], axis=3)
    leverage = np.einsum("npdi,nij,npdj->np", slopes, by_frame, slopes, optimize=True)
    leverage = (weight * leverage).sum(axis=0) / np.square(state.sigma)
    squares = (weight * np.square(system.residual).sum(axis=2)).sum(axis=0)
    directions = system.residual.shape[2]
    free = directions * (weight > 0.0).sum(axis=0) - leverage
    # A point that its own coordinate follows everywhere tells nothing of its noise: there all are taken alike.
    alike = squares.sum() / max(float(free.sum()), 1.0)
    enough = free > 0.05 * directions * weight.shape[0]
    variance = np.where(enough, squares / np.maximum(free, 1e-9), alike)
    return np.asarray(np.sqrt(variance * float(np.median(frames_alike(system.residual)))))


def frames_alike(residual: FloatArray) -> FloatArray:
    """Return how many frames (points,) the errors of a point stay alike: 1 + 2 sum of its autocorrelations.

    Errors of tracking wander. A smooth motion meets the spectral density of the noise at low frequencies, which is that
    many times the one of white noise of equal variance. The sum ends where a pair of lags is no longer positive
    ([Geyer1992], sect. 3.3).
    """
    n = len(residual)
    power = np.square(np.abs(np.fft.rfft(residual, 2 * n, axis=0))).sum(axis=2)
    products = np.fft.irfft(power, axis=0)[: n // 4]
    correlation = products / np.maximum(products[0], 1e-300)
    pairs = correlation[1:-1:2] + correlation[2::2]
    going = np.cumprod(pairs > 0.0, axis=0)
    return np.asarray(np.clip(1.0 + 2.0 * (pairs * going).sum(axis=0), 1.0, n / 8))


def _by_frame(system: System, covariance: FloatArray, count: int, size: int) -> FloatArray:
    """Return the covariance of coordinates and shared, frame by frame (n, k, k)."""
    design, shared = system.design, covariance.shape[0] - count * size
    found = np.empty((len(design), count + shared, count + shared))
    for i in range(count):
        rows = slice(i * size, (i + 1) * size)
        for j in range(i + 1):
            block = covariance[rows, j * size : (j + 1) * size]
            found[:, i, j] = found[:, j, i] = np.einsum("ni,ni->n", design @ block, design)
        found[:, i, count:] = design @ covariance[rows, count * size :]
        found[:, count:, i] = found[:, i, count:]
    found[:, count:, count:] = covariance[count * size :, count * size :]
    return found


def intensity(
    state: State, covariance: FloatArray, rough: FloatArray, basis: Basis, kinds: IntArray, first: FloatArray
) -> FloatArray:
    """Return the intensities (coordinates,) that maximise the evidence, one for each kind."""
    count, size = state.coefficients.shape
    squares, known = np.zeros(count), np.zeros(count)
    rank = float(basis.splines - 3)
    for i in range(count):
        rows = slice(i * size, (i + 1) * size)
        own = state.coefficients[i]
        squares[i] = own @ rough @ own / state.intensity[i]
        known[i] = rank - float((rough * covariance[rows, rows]).sum()) / state.intensity[i]
    found = np.empty(count)
    for kind in np.unique(kinds):
        alike = kinds == kind
        held = _HELD * _LOW * float((first[alike] / state.intensity[alike]).mean())
        # The step of expectation maximisation, which is safe, lengthened where the data know few of the coefficients.
        unknown = float((rank - known[alike]).sum())
        ratio = (float(squares[alike].sum()) + unknown + held) / (rank * alike.sum() + _HELD)
        longer = min(rank * alike.sum() / max(float(known[alike].sum()), 1.0), _LONGEST)
        found[alike] = state.intensity[alike] * ratio**longer
    return np.clip(found, _LEAST * first, _MOST * first)


def settled(before: State, after: State) -> bool:
    """Return whether noise and intensities stay; the sixth root of an intensity is a frequency."""
    by_noise = np.abs(np.log(after.sigma / before.sigma)).max()
    smooth = np.abs(np.log(after.intensity / before.intensity)).max() / 6.0
    return bool(max(by_noise, smooth) < _SETTLED)
