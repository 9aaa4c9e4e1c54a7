"""Whitening by a Kalman filter: exact from the first sample on, and where samples are missing.

Noise v with a state s,   s_{t+1} = F_t s_t + w_t,  v_t = H s_t + e_t,   is a triangular transform of white innovations.
The e_t of a sample's channels are independent, so that one channel after the other is told: of channel c, with what is
known before it,

    S = h P h' + r,   white = (v_c - h s) / sqrt(S),   g = P h' / sqrt(S),   s <- s + g white,   P <- P - g g'

([Kalman1960]; [Jones1980] on missing samples). The gains depend on the model alone and are made once; then residuals
and sensitivities pass the same linear filter.

[Kalman1960] R. E. Kalman, J. Basic Engineering 82. [Jones1980] R. H. Jones, Technometrics 22.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.compiled import compiled, merged, part


class Sparse(NamedTuple):
    """Matrices of a series that are zero in the same places: of an hour of samples only the rest has room.

    Attributes:
        row, column: (e,) where they are not zero.
        value: (n, e) what is there; one for all times where n = 1.
        shape: of one matrix.
    """

    row: Any
    column: Any
    value: FloatArray
    shape: tuple[int, int]

    @staticmethod
    def places(there: BoolArray) -> tuple[Any, ...]:
        """Return `row` and `column` of where matrices may not be zero, of one layout: kernels are compiled once."""
        return tuple(map(np.ascontiguousarray, np.nonzero(there)))

    @staticmethod
    def of(matrices: FloatArray) -> Sparse:
        """Return matrices (n, i, j), or one (i, j) for all times."""
        every = matrices if matrices.ndim == 3 else matrices[None]
        row, column = Sparse.places(np.any(every != 0.0, axis=0))
        return Sparse(row, column, np.ascontiguousarray(every[:, row, column]), every.shape[1:])

    def at(self, t: int) -> FloatArray:
        """Return the matrix of a sample."""
        whole = np.zeros(self.shape)
        whole[self.row, self.column] = self.value[min(t, len(self.value) - 1)]
        return whole

    def part(self, samples: slice) -> Sparse:
        """Return those of some samples."""
        return self._replace(value=self.value[samples])


@dataclass(frozen=True, eq=False)
class Gains:
    """A filter made for one series of samples.

    Attributes:
        transition: F_t (d, d), from sample t to t + 1.
        reading: H_t (m, d).
        gain: (n, d, m) g of each channel; zero where the sample is missing.
        scale: (n, m) 1 / sqrt(S) of each channel; zero where the sample is missing.
    """

    transition: Sparse
    reading: Sparse
    gain: FloatArray
    scale: FloatArray

    @property
    def log_determinant(self) -> float:
        """Sum of log S over the samples that are there: log determinant of the covariance."""
        return -2.0 * float(np.sum(np.log(self.scale[self.scale > 0.0])))

    def scaled(self, sigma: float) -> Gains:
        """Return the filter of the noise times sigma."""
        return replace(self, gain=self.gain * sigma, scale=self.scale / sigma)


def gains(
    transition: FloatArray,
    drive: FloatArray,
    reading: FloatArray,
    spread: FloatArray,
    start: FloatArray,
    seen: BoolArray,
) -> Gains:
    """Make the filter of one series.

    Args:
        transition: (n or 1, d, d) F_t.
        drive: (n or 1, d, d) covariance of w_t.
        reading: (m, d) H, or (n, m, d) where it changes.
        spread: (m,) variances of e_t.
        start: (d, d) covariance of the state at the first sample.
        seen: (n,) whether there is a sample.
    """
    n, (m, d), moves, read = len(seen), reading.shape[-2:], Sparse.of(transition), Sparse.of(reading)
    gain, scale = np.zeros((n, d, m)), np.zeros((n, m))
    advance(moves, np.ascontiguousarray(drive), read, spread[None], start.copy(), seen.copy(), gain, scale)
    return Gains(moves, read, gain, scale)


@compiled
def advance(
    transition: Sparse,
    drive: FloatArray,
    reading: Sparse,
    spread: FloatArray,
    covariance: FloatArray,
    seen: BoolArray,
    gain: FloatArray,
    scale: FloatArray,
) -> None:
    """Write gains and scales of a stretch of samples.

    Loops, for numba takes seven seconds to compile products of matrices.

    Args:
        transition, drive, reading, spread, seen: as of `gains`; (n or 1, ...).
        covariance: (d, d) of the state at the first sample; becomes that behind the last.
        gain, scale: as of `Gains`.
    """
    d, m = gain.shape[1:]
    across = np.empty((1, d))  # h P, then g'
    ahead, turned = np.empty((d, d)), np.empty((d, d))
    for t in range(seen.shape[0]):
        value, white = reading.value[min(t, reading.value.shape[0] - 1)], spread[min(t, spread.shape[0] - 1)]
        if seen[t]:
            for c in range(m):
                for i in range(d):
                    across[0, i] = 0.0
                for e in range(value.shape[0]):
                    if reading.row[e] == c:
                        add_row(across, 0, covariance, reading.column[e], value[e])
                total = white[c]
                for e in range(value.shape[0]):
                    if reading.row[e] == c:
                        total += across[0, reading.column[e]] * value[e]
                if not total > 0.0:
                    raise np.linalg.LinAlgError("a covariance is not positive definite")
                scale[t, c] = 1.0 / np.sqrt(total)
                for i in range(d):
                    across[0, i] *= scale[t, c]
                    gain[t, i, c] = across[0, i]
                for i in range(d):
                    add_row(covariance, i, across, 0, -across[0, i])
        _carry(transition, t, drive[min(t, drive.shape[0] - 1)], covariance, ahead, turned)


@part
def _carry(
    moves: Sparse, t: int, driven: FloatArray, covariance: FloatArray, ahead: FloatArray, turned: FloatArray
) -> None:
    """Turn a covariance P into F P F' + Q, that of the next sample."""
    d, value = covariance.shape[0], moves.value[min(t, moves.value.shape[0] - 1)]
    _product(moves, value, covariance, ahead)
    for i in range(d):
        for j in range(d):
            turned[j, i] = ahead[i, j]
    _product(moves, value, turned, ahead)
    for i in range(d):
        for j in range(i + 1):
            covariance[i, j] = covariance[j, i] = 0.5 * (ahead[i, j] + ahead[j, i] + driven[i, j] + driven[j, i])


@compiled
def variances(transition: Sparse, drive: FloatArray, covariance: FloatArray, reading: Sparse, out: FloatArray) -> None:
    """Write diag H P H' (n, m) of a stretch of samples that nothing is measured of; arguments as of `advance`."""
    d, m = covariance.shape[0], out.shape[1]
    across, ahead, turned = np.empty((m, d)), np.empty((d, d)), np.empty((d, d))
    for t in range(out.shape[0]):
        value = reading.value[min(t, reading.value.shape[0] - 1)]
        _product(reading, value, covariance, across)
        for e in range(value.shape[0]):
            out[t, reading.row[e]] += across[reading.row[e], reading.column[e]] * value[e]
        _carry(transition, t, drive[min(t, drive.shape[0] - 1)], covariance, ahead, turned)


@merged
def _product(a: Sparse, value: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write a @ b."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = 0.0
    for e in range(value.shape[0]):
        add_row(out, a.row[e], b, a.column[e], value[e])


def whitened(filter_: Gains, seen: BoolArray, columns: FloatArray) -> FloatArray:
    """Return the white innovations (samples seen, m, k) of columns (samples seen, m, k)."""
    out = np.empty_like(columns)
    _whiten(filter_.transition, filter_.reading, filter_.gain, filter_.scale, seen, np.ascontiguousarray(columns), out)
    return out


def filtered_states(filter_: Gains, series: FloatArray) -> FloatArray:
    """Return the states s_t|t (n, d) of channels (n, m); what stands where no sample is seen is ignored."""
    white = whitened(filter_, np.ones(len(series), dtype=np.bool_), series[:, :, None])
    states, state = np.empty(filter_.gain.shape[:2]), np.zeros(filter_.gain.shape[1])
    for t, innovation in enumerate(white[:, :, 0]):
        states[t] = state = state + filter_.gain[t] @ innovation
        state = filter_.transition.at(t) @ state
    return states


@compiled
def _whiten(
    transition: Sparse,
    reading: Sparse,
    gain: FloatArray,
    scale: FloatArray,
    seen: BoolArray,
    columns: FloatArray,
    out: FloatArray,
) -> None:
    d, m = gain.shape[1:]
    width = columns.shape[2]
    state = np.zeros((d, width))
    ahead = np.zeros((d, width))
    row = 0
    for t in range(seen.shape[0]):
        if seen[t]:
            value = reading.value[min(t, reading.value.shape[0] - 1)]
            for c in range(m):
                for k in range(width):  # numba compiles three seconds of error messages for a slice
                    out[row, c, k] = columns[row, c, k] * scale[t, c]
                for e in range(value.shape[0]):
                    if reading.row[e] == c:
                        add_row(out[row], c, state, reading.column[e], -value[e] * scale[t, c])
                for i in range(d):
                    add_row(state, i, out[row], c, gain[t, i, c])
            row += 1
        _product(transition, transition.value[min(t, transition.value.shape[0] - 1)], state, ahead)
        state, ahead = ahead, state


@merged
def add_row(target: FloatArray, row: int, source: FloatArray, other: int, weight: float) -> None:
    """Add a row of `source` times a weight to one of `target`."""
    for k in range(source.shape[1]):
        target[row, k] += weight * source[other, k]
