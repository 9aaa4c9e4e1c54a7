"""What the residuals' own correlation in time makes of a sum over samples: the middle of a sandwich.

    var(A' e) = sum_r A_r' Omega_r A_r,    Omega_r[(t, c), (s, d)] = gamma_cd(s - t)

with the covariances gamma of channels c and d of the residual e of trial r, tapered by the flat-top window of
[Politis1995] whose length the data choose ([Politis2003]). A kernel on the products A e itself ([Newey1987]) would not
need e to be stationary, but is much the noisier of the two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from mjfish.data.trial import rows_of
from mjfish.estimation.problem import Problem
from mjfish.numerics.arrays import BoolArray, FloatArray, RecordArray
from mjfish.numerics.block_angular import Basis, IntArray

#: Correlations below this many of sqrt(log10(n) / n) at `_RUN` lags in a row are none ([Politis2003]).
_CRITICAL = 2.0
_RUN = 5
#: Longest window, as a share of the shortest trial.
_LONGEST = 0.25
#: Rounds of giving back what the fit took out of the covariances.
_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Block:
    """Whitened residuals of one trial on a grid of equal steps, zero where no sample counts.

    Attributes:
        trial: its name.
        residual: (n, 3).
        rows: (m,) places of its numbers in the whitened residual of the problem.
        cells: (samples,) where these are on the grid.
        step: of the grid [s].
        series: what they are residuals of: the velocities, or a sensor by its name. Only those of one series are alike.
    """

    trial: str
    residual: FloatArray
    rows: IntArray
    cells: IntArray
    step: float
    series: str = ""

    @property
    def counted(self) -> BoolArray:
        """Whether a sample is there (n,)."""
        return np.isin(np.arange(len(self.residual)), self.cells)

    def on_grid(self, columns: FloatArray) -> FloatArray:
        """Return columns (m, k) at `rows` as (n, 3, k) on the grid; channels that a sensor has not are zero."""
        found = np.zeros((len(self.residual), 3, columns.shape[1]))
        channels = len(self.rows) // max(len(self.cells), 1)
        found[self.cells, :channels] = columns.reshape(len(self.cells), channels, columns.shape[1])
        return found


def serial_blocks(problem: Problem, residual: FloatArray) -> tuple[Block, ...]:
    """Return the whitened residual (n,) of the velocities trial by trial, then of every sensor."""
    read = (
        _block(
            residual,
            sensor.time[problem.sensor_mask(i, sensor)],
            rows,
            problem.trials[i].name,
            sensor.step,
            sensor.name,
        )
        for (i, sensor), rows in zip(problem.sensors, problem.sensor_rows, strict=True)
    )
    return tuple(block for block in (*blocks_of(problem, residual), *read) if len(block.rows))


def blocks_of(problem: Problem, residual: FloatArray) -> tuple[Block, ...]:
    """Return the whitened residual (n,) of the velocities trial by trial."""
    return tuple(
        _block(residual, trial.time[problem.mask(i)], rows, trial.name, trial.step)
        for i, (trial, rows) in enumerate(zip(problem.trials, problem.rows_by_trial(), strict=True))
    )


def _block(residual: FloatArray, time: FloatArray, rows: slice, trial: str, step: float, series: str = "") -> Block:
    cells = rows_of(time)[: len(time)]
    nothing = np.zeros((int(cells.max(initial=-1)) + 1, 3))
    block = Block(trial, nothing, np.arange(rows.start, rows.stop), cells, step, series)
    return replace(block, residual=block.on_grid(residual[rows, None])[:, :, 0])


@dataclass(frozen=True, eq=False)
class Serial:
    """Covariance of the residuals in time, by trial.

    Attributes:
        spectra: one (f, 3, 3) a trial, Hermitian and not negative: Omega on a circle of `lengths` samples.
        tapers: one (l, 3, 3) a trial: weight of a product at each lag on the circle.
        lengths: of the circles.
        windows: (3,) longest lag [s] that counts in the velocities, by channel, in any trial.
    """

    spectra: tuple[RecordArray, ...]
    tapers: tuple[FloatArray, ...]
    lengths: tuple[int, ...]
    windows: FloatArray

    def times(self, r: int, columns: FloatArray) -> FloatArray:
        """Return Omega_r times columns (n, 3, k)."""
        found = np.empty_like(columns)
        for some in _at_a_time(columns):
            waves = fft.rfft(columns[:, :, some], self.lengths[r], axis=0)
            found[:, :, some] = fft.irfft(self.spectra[r] @ waves, self.lengths[r], axis=0)[: len(columns)]
        return found

    def quadratic_of(self, r: int, columns: FloatArray) -> FloatArray:
        """Return A' Omega_r A (k, k) of the columns A (n, 3, k) of one block."""
        return np.asarray(np.einsum("tci,tcj->ij", columns, self.times(r, columns)))

    def moments(self, r: int, columns: FloatArray, *, total: bool = False) -> FloatArray:
        """Return what one block adds to mean and variance (2, k) of the diagonal of its quadratic form, or of its sum.

        A variance v = e'T e that is estimated from Gaussian e has var(v) = 2 tr(T Omega T Omega) and counts like a sum
        of 2 v^2 / var(v) squares; T is Toeplitz, with the tapered autocorrelation of the column on its diagonals.
        """
        n, length = len(columns), self.lengths[r]
        with np.errstate(over="ignore", invalid="ignore"):  # columns that a fish at rest leaves without energy
            powers = (np.abs(fft.rfft(columns[:, :, some], length, axis=0)) ** 2 for some in _at_a_time(columns))
            if total:
                return self._moments(r, n, np.asarray(sum(power.sum(axis=2, keepdims=True) for power in powers)))
            return np.concatenate([self._moments(r, n, power) for power in powers], axis=1)

    def _moments(self, r: int, n: int, power: FloatArray) -> FloatArray:
        """Return the moments (2, k) of columns of n samples with the power spectra (f, 3, k)."""
        length = self.lengths[r]
        own = np.einsum("lcc->lc", self.tapers[r])[:, :, None]
        weight = fft.rfft(fft.irfft(power, length, axis=0) * own, axis=0).real
        shares = weight * np.einsum("fcc->fc", self.spectra[r]).real[:, :, None]
        both = np.full(len(shares), 2.0)
        both[0] = 1.0
        value = n / length * np.einsum("f,fck->k", both, shares)
        return np.stack([value, 2.0 * n / length * np.einsum("f,fck->k", both, shares**2)])


#: Numbers that are transformed at a time: of an hour of samples and ten columns, those of a few columns.
_NUMBERS = 4_000_000


def _at_a_time(columns: FloatArray | BoolArray) -> list[slice]:
    """Return which columns (n, c, k) are transformed at a time."""
    width = max(_NUMBERS // max(columns[:, :, :1].size, 1), 1)
    return [slice(first, first + width) for first in range(0, max(columns.shape[2], 1), width)]


def satterthwaite(mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the degrees of freedom (k,) of estimates of a variance, of mean (k,) and variance (k,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(2.0 * mean**2 / np.maximum(variance, 1e-300)))


def serial(blocks: Sequence[Block], basis: Basis) -> Serial:
    """Estimate the covariance of the residuals in time.

    What the fit of the free parameters took out of the residual, e = (1 - U U') u, is given back:

        E[e e'] = Omega - U W' - W U',   W = Omega U - U (U' Omega U) / 2

    which is the n / (n - p) of white residuals, and more where they are correlated and few.

    Args:
        blocks: of a fit.
        basis: U, of the derivatives by the parameters that were free and off their bounds.
    """
    own = [basis.at(block.rows) for block in blocks]
    columns = [block.on_grid(np.hstack([q, s])) for block, (_, q, s) in zip(blocks, own, strict=True)]
    runs = [run for run, _, _ in own]
    shared = basis.shared.shape[1]

    def over_blocks(middles: list[FloatArray]) -> list[FloatArray]:
        """Return U' Omega U of each block's columns: of shared ones over all blocks, else over those of its run."""
        common = sum((m[-shared:, -shared:] for m in middles if shared), np.zeros((shared, shared)))
        whole: dict[int, FloatArray] = {}
        for run, middle in zip(runs, middles, strict=True):
            whole[run] = whole[run] + middle if run in whole else middle
        for middle in whole.values():
            middle[len(middle) - shared :, len(middle) - shared :] = common
        return [whole[run] for run in runs]

    return _serial(blocks, columns, over_blocks)


def serial_apart(blocks: Sequence[Block], bases: Sequence[FloatArray]) -> Serial:
    """Estimate the same of trials that were fitted alone, with bases (n_r, 3, k) of their own."""
    return _serial(blocks, bases, lambda middles: middles)


def _serial(
    blocks: Sequence[Block], basis: Sequence[FloatArray], joined: Callable[[list[FloatArray]], list[FloatArray]]
) -> Serial:
    longest = {
        s: int(_LONGEST * min(len(b.residual) for b in blocks if b.series == s))
        for s in {block.series for block in blocks}
    }
    lengths = tuple(fft.next_fast_len(len(b.residual) + longest[b.series] + 1, real=True) for b in blocks)
    pairs = list(zip(blocks, lengths, strict=True))
    sums = [_lag_sums(block.residual[:, :, None], block.residual[:, :, None], n) for block, n in pairs]
    counts = [_lag_sums(block.counted[:, None, None], block.counted[:, None, None], n)[:, 0, 0] for block, n in pairs]
    found = _smoothed(blocks, sums, counts, lengths, longest)
    for _ in range(_ROUNDS):
        turned = [found.times(r, u) for r, u in enumerate(basis)]
        middles = joined([np.einsum("tci,tcj->ij", u, w) for u, w in zip(basis, turned, strict=True)])
        quads = zip(basis, turned, middles, lengths, strict=True)
        taken = [_lag_sums(u, w - 0.5 * u @ m, n) for u, w, m, n in quads]
        corrected = [s + t + _turned(t) for s, t in zip(sums, taken, strict=True)]
        found = _smoothed(blocks, corrected, counts, lengths, longest)
    return found


def middle(found: Serial, blocks: Sequence[Block], basis: Basis, measured: int) -> FloatArray:
    """Return Q' Omega Q (rank, rank) of a basis; Omega is 1 in the rows behind the `measured` ones."""
    known = basis.of_rows(np.arange(measured, len(basis.shared)))
    result = known.T @ known
    for r, block in enumerate(blocks):
        run, q, shared = basis.at(block.rows)
        places = np.concatenate([basis.places_of(run), basis.places_of(None)])
        result[np.ix_(places, places)] += found.quadratic_of(r, block.on_grid(np.hstack([q, shared])))
    return result


def _smoothed(
    blocks: Sequence[Block],
    sums: Sequence[FloatArray],
    counts: Sequence[FloatArray],
    lengths: tuple[int, ...],
    longest: Mapping[str, int],
) -> Serial:
    """Return the spectra of lag sums under the window that they choose."""
    reach = _windows(blocks, sums, counts, longest)
    tapers = tuple(
        _taper(reach[block.series, block.step], length) / np.maximum(count, 0.5)[:, None, None]
        for block, length, count in zip(blocks, lengths, counts, strict=True)
    )
    own = (np.diag(reach["", block.step]) * block.step for block in blocks if not block.series)
    windows = np.max([np.zeros(3), *own], axis=0)
    return Serial(tuple(_spectrum(s * w) for s, w in zip(sums, tapers, strict=True)), tapers, lengths, windows)


def _lag_sums(x: FloatArray | BoolArray, y: FloatArray | BoolArray, length: int) -> FloatArray:
    """Return sum over t and k of x_ck(t) y_dk(t + l) for l = 0, 1, .. -2, -1 on a circle, (length, c, d)."""
    total = np.zeros((length // 2 + 1, x.shape[1], y.shape[1]), dtype=np.complex128)
    for some in _at_a_time(x):
        a, b = (fft.rfft(np.asarray(v[:, :, some], dtype=np.float64), length, axis=0) for v in (x, y))
        total += np.conj(a) @ np.swapaxes(b, 1, 2)
    return np.asarray(fft.irfft(total, length, axis=0))


def _windows(
    blocks: Sequence[Block], sums: Sequence[FloatArray], counts: Sequence[FloatArray], longest_of: Mapping[str, int]
) -> dict[tuple[str, float], FloatArray]:
    """Return the longest lag (3, 3) of each pair of channels, by series and step; -1: not even the lag 0 counts.

    Twice the smallest m from which on `_RUN` correlations in a row, pooled over trials, are below
    `_CRITICAL` sqrt(log10(n) / n).
    """
    result = {}
    for series, step in {(block.series, block.step) for block in blocks}:
        mine = [r for r, block in enumerate(blocks) if (block.series, block.step) == (series, step)]
        longest = longest_of[series]
        at = np.arange(-longest, longest + 1)
        pooled = (
            np.sum([sums[r][at] for r in mine], axis=0) / np.sum([counts[r][at] for r in mine], axis=0)[:, None, None]
        )
        spread = np.sqrt(np.maximum(np.einsum("cc->c", pooled[longest]), 0.0))
        correlation = np.abs(pooled) / np.maximum(np.outer(spread, spread), 1e-300)
        seen = np.maximum(correlation[longest:], correlation[longest::-1])
        n = np.sum([counts[r][0] for r in mine])
        small = seen < _CRITICAL * np.sqrt(np.log10(n) / n)
        runs = np.lib.stride_tricks.sliding_window_view(small, min(_RUN, len(small)), axis=0).all(axis=-1)
        m = np.where(runs.any(axis=0), runs.argmax(axis=0) - 1, longest)
        result[series, step] = np.where(m < 0, m, np.minimum(2 * np.maximum(m, 0), longest)).astype(np.float64)
    return result


def _taper(reach: FloatArray, length: int) -> FloatArray:
    """Return the flat-top window (length, 3, 3) on a circle: 1 up to half the reach, then straight down to 0."""
    lag = np.minimum(np.arange(length), length - np.arange(length))[:, None, None]
    sloped = np.clip(2.0 - 2.0 * lag / np.maximum(reach, 1.0), 0.0, 1.0)
    return np.asarray(np.where(reach < 0.0, 0.0, np.where(lag == 0, 1.0, np.where(reach < 1.0, 0.0, sloped))))


def _turned(sums: FloatArray) -> FloatArray:
    """Return the lag sums with the two series swapped: lag l of c and d becomes lag -l of d and c."""
    return np.swapaxes(np.roll(sums[::-1], 1, axis=0), 1, 2)


def _spectrum(covariance: FloatArray) -> RecordArray:
    """Return the spectrum (f, 3, 3) of covariances on a circle, negative eigenvalues made zero."""
    spectrum = np.conj(fft.rfft(covariance, axis=0))
    if not np.any(covariance[:, ~np.eye(3, dtype=np.bool_)]):
        return np.asarray(np.maximum(spectrum.real, 0.0))
    values, vectors = np.linalg.eigh(0.5 * (spectrum + np.conj(np.swapaxes(spectrum, 1, 2))))
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ np.conj(np.swapaxes(vectors, 1, 2)))
