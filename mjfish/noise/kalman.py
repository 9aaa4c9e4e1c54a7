"""Whitening by a Kalman filter: exact from the first sample on, and where samples are missing.

Noise v with a state s,   s_{t+1} = F_t s_t + w_t,  v_t = H s_t + e_t,   is a triangular transform of white innovations,

    i_t = v_t - H s_t|t-1,   S_t = H P_t|t-1 H' + R,   white_t = chol(S_t)^-1 i_t,   s_t|t = s_t|t-1 + K_t i_t

([Kalman1960]; [Jones1980] on missing samples). The gains depend on the model alone and are made once; then residuals
and sensitivities pass the same linear filter.

[Kalman1960] R. E. Kalman, J. Basic Engineering 82. [Jones1980] R. H. Jones, Technometrics 22.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.compiled import compiled, merged, part


@dataclass(frozen=True, eq=False)
class Gains:
    """A filter made for one series of samples.

    Attributes:
        transition: (n, d, d) F_t, from sample t to t + 1; one for all where n = 1.
        reading: (m, d) H, or (n, m, d) where it changes.
        gain: (n, d, m) K_t; zero where the sample is missing.
        root: (n, m, m) inverse of the Cholesky factor of S_t.
        log_determinant: sum of log det S_t over the samples that are there.
    """

    transition: FloatArray
    reading: FloatArray
    gain: FloatArray
    root: FloatArray
    log_determinant: float

    def scaled(self, sigma: float) -> Gains:
        """Return the filter of the noise times sigma; the filter is one of a single channel."""
        samples = np.count_nonzero(self.root)
        determinant = self.log_determinant + samples * float(np.log(sigma**2))
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
        spread: (m, m) covariance R of e_t, or (n, m, m).
        start: (d, d) covariance of the state at the first sample.
        seen: (n,) whether there is a sample.
    """
    n, (m, d) = len(seen), reading.shape[-2:]
    gain, root = np.zeros((n, d, m)), np.zeros((n, m, m))
    total = _gains(
        np.ascontiguousarray(transition), np.ascontiguousarray(drive), _each(reading), _each(spread), start.copy(),
        seen, gain, root,
    )  # fmt: skip
    return Gains(np.ascontiguousarray(transition), np.ascontiguousarray(reading), gain, root, float(total))


def _each(matrices: FloatArray) -> FloatArray:
    """Return matrices (n or 1, i, j), one for all times where there is one alone."""
    return np.ascontiguousarray(matrices if matrices.ndim == 3 else matrices[None])


@compiled
def _gains(
    transition: FloatArray,
    drive: FloatArray,
    reading: FloatArray,
    spread: FloatArray,
    covariance: FloatArray,
    seen: BoolArray,
    gain: FloatArray,
    root: FloatArray,
) -> float:
    """Write gains and roots; loops, for numba takes seven seconds to compile products and factors of matrices."""
    total = 0.0
    last = transition.shape[0] - 1
    m, d = reading.shape[1:]
    across, innovation = np.empty((m, d)), np.empty((m, m))  # H P, S
    ahead = np.empty((d, d))
    for t in range(seen.shape[0]):
        if seen[t]:
            read, white = reading[min(t, reading.shape[0] - 1)], spread[min(t, spread.shape[0] - 1)]
            _product(read, covariance, across)
            for i in range(m):
                for j in range(m):
                    innovation[i, j] = white[i, j]
                    for k in range(d):
                        innovation[i, j] += across[i, k] * read[j, k]
            factor = root[t]
            _invert_root(innovation, factor)
            for k in range(m):
                total -= 2.0 * np.log(factor[k, k])
            for i in range(d):
                for j in range(m):
                    gain[t, i, j] = 0.0
                    for k in range(m):
                        weight = 0.0  # of the inverse of S
                        for n in range(m):
                            weight += factor[n, k] * factor[n, j]
                        gain[t, i, j] += across[k, i] * weight
            for i in range(d):
                for j in range(d):
                    for k in range(m):
                        covariance[i, j] -= gain[t, i, k] * across[k, j]
        moves, driven = transition[min(t, last)], drive[min(t, drive.shape[0] - 1)]
        _product(moves, covariance, ahead)
        for i in range(d):
            for j in range(i + 1):
                one, other = driven[i, j], driven[j, i]
                for k in range(d):
                    one += ahead[i, k] * moves[j, k]
                    other += ahead[j, k] * moves[i, k]
                covariance[i, j] = covariance[j, i] = 0.5 * (one + other)
    return total


@part
def _product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write a @ b."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
            for k in range(b.shape[0]):
                out[i, j] += a[i, k] * b[k, j]


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
    reading = _each(filter_.reading)
    _whiten(filter_.transition, reading, filter_.gain, filter_.root, seen, np.ascontiguousarray(columns), out)
    return out


def coloured(filter_: Gains, seen: BoolArray, white: FloatArray) -> FloatArray:
    """Return noise (samples seen, m) that `whitened` makes `white` (samples seen, m): the inverse transform."""
    state, rows, last = np.zeros(filter_.reading.shape[1]), iter(white), len(filter_.transition) - 1
    out = []
    for t in range(len(seen)):
        if seen[t]:
            innovation = np.linalg.solve(filter_.root[t], next(rows))
            out.append(filter_.reading @ state + innovation)
            state = state + filter_.gain[t] @ innovation
        state = filter_.transition[min(t, last)] @ state
    return np.array(out)


def filtered_states(filter_: Gains, seen: BoolArray, series: FloatArray) -> FloatArray:
    """Return the states s_t|t (n, d) of one channel (n,), what stands where no sample is seen ignored."""
    states, state = np.empty((len(seen), filter_.reading.shape[1])), np.zeros(filter_.reading.shape[1])
    reading, last = filter_.reading[0], len(filter_.transition) - 1
    for t in range(len(seen)):  # the gain is zero where a sample is missing
        state = state + filter_.gain[t, :, 0] * (series[t] - reading @ state)
        states[t] = state
        state = filter_.transition[min(t, last)] @ state
    return states


@compiled
def _whiten(
    transition: FloatArray,
    reading: FloatArray,
    gain: FloatArray,
    root: FloatArray,
    seen: BoolArray,
    columns: FloatArray,
    out: FloatArray,
) -> None:
    last = transition.shape[0] - 1
    m, d = reading.shape[1:]
    width = columns.shape[2]
    state = np.zeros((d, width))
    ahead = np.zeros((d, width))
    innovation = np.zeros((m, width))
    row = 0
    for t in range(seen.shape[0]):
        if seen[t]:
            for i in range(m):
                for k in range(width):  # numba compiles three seconds of error messages for a slice
                    innovation[i, k] = columns[row, i, k]
                _add(innovation, i, reading[min(t, reading.shape[0] - 1), i], state, -1.0)
            for i in range(d):
                _add(state, i, gain[t, i], innovation, 1.0)
            for i in range(m):
                out[row, i] = 0.0
                _add(out[row], i, root[t, i], innovation, 1.0)
            row += 1
        ahead[:] = 0.0
        for i in range(d):
            _add(ahead, i, transition[min(t, last), i], state, 1.0)
        state, ahead = ahead, state


@merged
def _add(target: FloatArray, row: int, weights: FloatArray, source: FloatArray, sign: float) -> None:
    """Add sign * weights @ source to a row; most weights are zero."""
    for j in range(weights.shape[0]):
        weight = sign * weights[j]
        if weight != 0.0:
            for k in range(source.shape[1]):
                target[row, k] += weight * source[j, k]
