"""Whitening by a Kalman filter: exact from the first sample on, and where samples are missing.

Noise v with a state s,   s_{t+1} = F_t s_t + w_t,  v_t = H s_t + e_t,   is a triangular transform of white innovations,

    i_t = v_t - H s_t|t-1,   S_t = H P_t|t-1 H' + R,   white_t = chol(S_t)^-1 i_t,   s_t|t = s_t|t-1 + K_t i_t

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
        gain: (n, d, m) K_t; zero where the sample is missing.
        root: (n, m, m) inverse of the Cholesky factor of S_t.
        log_determinant: sum of log det S_t over the samples that are there.
    """

    transition: Sparse
    reading: Sparse
    gain: FloatArray
    root: FloatArray
    log_determinant: float

    def scaled(self, sigma: float) -> Gains:
        """Return the filter of the noise times sigma; the filter is one of a single channel."""
        determinant = self.log_determinant + np.count_nonzero(self.root) * float(np.log(sigma**2))
        return replace(self, root=self.root / sigma, log_determinant=determinant)


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
        spread: (m, m) covariance R of e_t.
        start: (d, d) covariance of the state at the first sample.
        seen: (n,) whether there is a sample.
    """
    n, (m, d), moves, read = len(seen), reading.shape[-2:], Sparse.of(transition), Sparse.of(reading)
    gain, root = np.zeros((n, d, m)), np.zeros((n, m, m))
    total = advance(moves, np.ascontiguousarray(drive), read, spread[None], start.copy(), seen.copy(), gain, root)
    return Gains(moves, read, gain, root, float(total))


@compiled
def advance(
    transition: Sparse,
    drive: FloatArray,
    reading: Sparse,
    spread: FloatArray,
    covariance: FloatArray,
    seen: BoolArray,
    gain: FloatArray,
    root: FloatArray,
) -> float:
    """Write gains and roots of a stretch of samples; return what they add to the log determinant.

    Loops, for numba takes seven seconds to compile products and factors of matrices.

    Args:
        transition, drive, reading, spread, seen: as of `gains`; (n or 1, ...).
        covariance: (d, d) of the state at the first sample; becomes that behind the last.
        gain, root: as of `Gains`.
    """
    total = 0.0
    d, m = gain.shape[1:]
    across, innovation = np.empty((m, d)), np.empty((m, m))  # H P, S
    ahead, turned, here = np.empty((d, d)), np.empty((d, d)), np.empty((d, m))
    for t in range(seen.shape[0]):
        if seen[t]:
            value, white = reading.value[min(t, reading.value.shape[0] - 1)], spread[min(t, spread.shape[0] - 1)]
            _product(reading, value, covariance, across)
            for i in range(m):
                for j in range(m):
                    innovation[i, j] = white[i, j]
                for e in range(value.shape[0]):
                    innovation[i, reading.row[e]] += across[i, reading.column[e]] * value[e]
            factor = root[t]
            _invert_root(innovation, factor)
            for k in range(m):
                total -= 2.0 * np.log(factor[k, k])
            for i in range(d):
                for j in range(m):
                    here[i, j] = 0.0
                    for k in range(m):
                        weight = 0.0  # of the inverse of S
                        for n in range(m):
                            weight += factor[n, k] * factor[n, j]
                        here[i, j] += across[k, i] * weight
                    gain[t, i, j] = here[i, j]
            for i in range(d):
                for k in range(m):
                    for j in range(d):
                        covariance[i, j] -= here[i, k] * across[k, j]
        _carry(transition, t, drive[min(t, drive.shape[0] - 1)], covariance, ahead, turned)
    return total


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
        _add(out, a.row[e], b, a.column[e], value[e])


@part
def _invert_root(matrix: FloatArray, out: FloatArray) -> None:
    """Write the inverse of the Cholesky factor of a matrix, whose lower triangle becomes that factor."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            if i == j and not rest > 0.0:
                raise np.linalg.LinAlgError("a covariance is not positive definite")
            matrix[i, j] = np.sqrt(rest) if i == j else rest / matrix[j, j]
    for j in range(n):
        out[j, j] = 1.0 / matrix[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= matrix[i, k] * out[k, j]
            out[i, j] = total / matrix[i, i]


def whitened(filter_: Gains, seen: BoolArray, columns: FloatArray) -> FloatArray:
    """Return the white innovations (samples seen, m, k) of columns (samples seen, m, k)."""
    out = np.empty_like(columns)
    _whiten(
        filter_.transition, filter_.reading, filter_.gain, filter_.root, seen, np.ascontiguousarray(columns), out
    )  # fmt: skip
    return out


def coloured(filter_: Gains, seen: BoolArray, white: FloatArray) -> FloatArray:
    """Return noise (samples seen, m) that `whitened` makes `white` (samples seen, m): the inverse transform."""
    state, rows, out = np.zeros(filter_.gain.shape[1]), iter(white), []
    for t in range(len(seen)):
        if seen[t]:
            innovation = np.linalg.solve(filter_.root[t], next(rows))
            out.append(filter_.reading.at(t) @ state + innovation)
            state = state + filter_.gain[t] @ innovation
        state = filter_.transition.at(t) @ state
    return np.array(out)


def filtered_states(filter_: Gains, series: FloatArray) -> FloatArray:
    """Return the states s_t|t (n, d) of channels (n, m); what stands where no sample is seen is ignored."""
    states, state = np.empty(filter_.gain.shape[:2]), np.zeros(filter_.gain.shape[1])
    for t, gain in enumerate(filter_.gain):  # zero where a sample is missing
        states[t] = state = state + gain @ (series[t] - filter_.reading.at(t) @ state)
        state = filter_.transition.at(t) @ state
    return states


@compiled
def _whiten(
    transition: Sparse,
    reading: Sparse,
    gain: FloatArray,
    root: FloatArray,
    seen: BoolArray,
    columns: FloatArray,
    out: FloatArray,
) -> None:
    d, m = gain.shape[1:]
    width = columns.shape[2]
    state = np.zeros((d, width))
    ahead = np.zeros((d, width))
    innovation = np.zeros((m, width))
    row = 0
    for t in range(seen.shape[0]):
        if seen[t]:
            value = reading.value[min(t, reading.value.shape[0] - 1)]
            for i in range(m):
                for k in range(width):  # numba compiles three seconds of error messages for a slice
                    innovation[i, k], out[row, i, k] = columns[row, i, k], 0.0
            for e in range(value.shape[0]):
                _add(innovation, reading.row[e], state, reading.column[e], -value[e])
            for i in range(d):
                for j in range(m):
                    _add(state, i, innovation, j, gain[t, i, j])
            for i in range(m):
                for j in range(i + 1):
                    _add(out[row], i, innovation, j, root[t, i, j])
            row += 1
        _product(transition, transition.value[min(t, transition.value.shape[0] - 1)], state, ahead)
        state, ahead = ahead, state


@merged
def _add(target: FloatArray, row: int, source: FloatArray, other: int, weight: float) -> None:
    """Add a row of `source` times a weight to one of `target`."""
    for k in range(source.shape[1]):
        target[row, k] += weight * source[other, k]
