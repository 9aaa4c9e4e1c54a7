"""Residuals from which a noise is estimated: spectra, and the likelihood of a noise model beside what was taken out.

Estimating the noise from the residual of a nominal model would count what is wrong with the model as noise. The
residual of the saturated model, which has every candidate in it, does not, to first order.

[Patterson1971] H. Patterson and R. Thompson, Biometrika 58.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import signal

from mjfish.data import Trial
from mjfish.noise.autoregressive import Autoregressive, Noise, estimate, grid
from mjfish.numerics.arrays import BoolArray, FloatArray, blocks_of, orthonormal, project_out
from mjfish.numerics.block_angular import BlockAngular, IntArray, block_angular, span, tall_svd

#: Draws of white noise that tell what the saturated model takes of a spectrum, and the least share that is left.
_DRAWS, _LEAST = 16, 0.02
#: Highest frequency of a spectrum, as a share of the sampling rate, and bands in which periodograms are averaged.
_HIGHEST, _BANDS = 0.45, 40
#: What the columns of single trials leave of whitened columns of all, below this share of the longest, is rounding.
_DUST = 1e-8


@dataclass(frozen=True, eq=False)
class NoiseSample:
    """Residuals of several trials, and the columns that were taken out of them.

    Attributes:
        trials: that the residuals belong to.
        masks: (samples,) per trial, which samples count.
        residuals: (n_r, 3) per trial, in physical units.
        scale: (3,) sigma by which channels were weighed when the columns were taken out.
        span: (n_r, 3, k) per trial, what was taken out of all; as columns divided by `scale`, orthonormal.
        apart: (n_r, 3, m) per trial, what was taken out of it alone, likewise, and orthogonal to those; beside it, of
            `without_trial_shapes`, what the likelihood alone leaves out.
        lost: degrees of freedom per channel that it took.
        shapes: per trial, returns functions (n_r, 3, m) that the residuals of all trials may share if something is
            wrong; they are many.
    """

    trials: tuple[Trial, ...]
    masks: list[BoolArray]
    residuals: list[FloatArray]
    scale: FloatArray
    span: list[FloatArray]
    apart: list[FloatArray]
    lost: float = 0.0
    shapes: Sequence[Callable[[], FloatArray]] | None = None

    @classmethod
    def of(
        cls, trials: Sequence[Trial], masks: Sequence[BoolArray], residuals: Sequence[FloatArray], scale: FloatArray
    ) -> NoiseSample:
        """Return residuals of which nothing was taken out."""
        nothing = [np.zeros((*block.shape, 0)) for block in residuals]
        return cls(tuple(trials), list(masks), list(residuals), scale, nothing, nothing)

    @property
    def free(self) -> float:
        """Degrees of freedom per channel that are left."""
        return sum(len(block) for block in self.residuals) - self.lost

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation (3,) of the channels."""
        return np.asarray(np.sqrt(sum((block**2).sum(axis=0) for block in self.residuals) / self.free))

    @property
    def rows(self) -> list[IntArray]:
        """Where the rows of every trial stand in columns over all of them."""
        return [np.arange(block.start, block.stop) for block in blocks_of([block.size for block in self.residuals])]

    @property
    def columns(self) -> BlockAngular:
        """The columns (3 n, k) that were taken out, divided by `scale`: orthonormal but for rounding."""
        span, apart = ([self._flat(block) for block in blocks] for blocks in (self.span, self.apart))
        return block_angular(np.concatenate(span), self.rows, apart)

    def _flat(self, block: FloatArray) -> FloatArray:
        """Return columns (n, 3, k) divided by `scale` as (3 n, k)."""
        return np.asarray((block / self.scale[:, None]).reshape(3 * len(block), block.shape[2]))

    def _by_channel(self, columns: FloatArray) -> FloatArray:
        """Return columns (3 n, k) that are divided by `scale` as (n, 3, k) in physical units."""
        return np.asarray(columns.reshape(len(columns) // 3, 3, columns.shape[1]) * self.scale[:, None])

    def of_trials(self, index: Sequence[int]) -> NoiseSample:
        """Return those of some trials, which take their share of the degrees of freedom."""
        count, total = sum(len(self.residuals[i]) for i in index), sum(map(len, self.residuals))
        return replace(
            self,
            trials=tuple(self.trials[i] for i in index),
            masks=[self.masks[i] for i in index],
            residuals=[self.residuals[i] for i in index],
            span=[self.span[i] for i in index],
            apart=[self.apart[i] for i in index],
            lost=self.lost * count / total,
            shapes=self.shapes and [self.shapes[i] for i in index],
        )

    def without(self, columns: BlockAngular) -> NoiseSample:
        """Return what is left when further columns (3 n, k), divided by `scale`, are taken out."""
        before, rows = self.columns, self.rows
        basis = span(before.beside(columns) if before.shape[1] else columns)
        del columns  # as large as the basis
        left = basis.off(np.concatenate([(block / self.scale).ravel() for block in self.residuals]))
        pairs = [(self._by_channel(shared), self._by_channel(own)) for _, own, shared in map(basis.at, rows)]
        return replace(
            self,
            residuals=[left[mine].reshape(-1, 3) * self.scale for mine in rows],
            span=[shared for shared, _ in pairs],
            apart=[own for _, own in pairs],
            lost=self.lost + (basis.rank - before.shape[1]) / 3.0,
        )

    def without_levels(self) -> NoiseSample:
        """Return what is left when the mean of every channel of every trial is taken out."""
        return self.without_trial_columns([np.broadcast_to(np.eye(3), (len(block), 3, 3)) for block in self.residuals])

    def without_trial_columns(self, blocks: Sequence[FloatArray]) -> NoiseSample:
        """Return what is left when columns (n, 3, k) of every trial alone, in physical units, are taken out."""
        own = [self._flat(block) for block in blocks]
        return self.without(block_angular(np.zeros((sum(map(len, own)), 0)), self.rows, own))

    def without_shapes(self) -> NoiseSample:
        """Return what is left when the `shapes` that trials may share are taken out."""
        blocks = (shape() for shape in self.shapes or [])
        return self.without(BlockAngular.of(np.concatenate([block.reshape(-1, block.shape[2]) for block in blocks])))

    def without_trial_shapes(self) -> NoiseSample:
        """Return a sample whose likelihood is that of what the `shapes` leave, each trial having sizes of its own."""
        own = [self._by_channel(orthonormal(self._flat(shape()))) for shape in self.shapes or []]
        pairs = zip(self.apart, own, strict=True)
        return replace(self, apart=[np.concatenate(pair, axis=2) for pair in pairs]) if own else self

    def autoregressive(self) -> Autoregressive:
        """Estimate autoregressive noise, order by BIC."""
        return estimate(
            self.residuals, self.lost, [grid(t.time, m) for t, m in zip(self.trials, self.masks, strict=True)]
        )

    def log_likelihood(self, noise: Noise) -> float:
        """Return the restricted log-likelihood of a noise model, less a constant.

        -1/2 (r' V^-1 r - r' V^-1 X (X' V^-1 X)^-1 X' V^-1 r + log det V + log det X' V^-1 X)  [Patterson1971]

        with the covariance V of the noise and the columns X that were taken out: what these explain of a slow noise is
        no evidence against it.
        """
        z, taken = self._whitened(noise)
        total = sum(noise.log_determinant(trial, mask) for trial, mask in zip(self.trials, self.masks, strict=True))
        return float(-0.5 * (total + np.sum(z**2)) - np.sum(np.log(taken)))

    def whitened_sigma(self, noise: Noise) -> FloatArray:
        """Return the standard deviations (3,) of the whitened residual: 1 under the true noise."""
        z, taken = self._whitened(noise)
        return np.asarray(np.sqrt(np.sum(z**2, axis=0) / (len(z) - len(taken) / 3.0)))

    def _whitened(self, noise: Noise) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residual (n, 3) less its part in the whitened columns X, and the lengths (k,) of these.

        The product of the lengths is the root of det X' X; what columns of a trial share counts once.
        """
        lengths, longest, rows = [], 0.0, self.rows
        both = np.zeros((sum(block.size for block in self.residuals), 1 + self.span[0].shape[2]))
        for i, (trial, mask) in enumerate(zip(self.trials, self.masks, strict=True)):
            taken = [self.residuals[i][:, :, None], self.span[i], self.apart[i]]
            white = noise.whiten(trial, mask, np.concatenate(taken, axis=2)).reshape(3 * len(taken[0]), -1)
            joint, apart = np.split(white, [both.shape[1]], axis=1)
            size = np.linalg.norm(apart, axis=0).max(initial=0.0)
            q, sizes, _ = tall_svd(apart)
            lengths.append(sizes[sizes > _DUST * size])
            both[rows[i]] = project_out(q[:, sizes > _DUST * size], joint)
            longest = max(longest, float(np.linalg.norm(joint[:, 1:], axis=0).max(initial=0.0)))
        q, sizes, _ = tall_svd(both[:, 1:])
        solid = sizes > _DUST * longest
        return project_out(q[:, solid], both[:, :1]).reshape(-1, 3), np.concatenate([*lengths, sizes[solid]])


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Mean periodograms in bands: middle [Hz] (b,), power (b, 3, 3), how many went into each (b,)."""

    frequency: FloatArray
    power: Any
    count: FloatArray


def spectrum(left: NoiseSample) -> Spectrum:
    """Return the spectrum of residuals, two-sided, per Hz: periodograms averaged in bands that widen with frequency."""
    step = left.trials[0].step
    series = zip(left.residuals, left.trials, left.masks, strict=True)
    pairs = [_periodogram(block, grid(trial.time, mask), step) for block, trial, mask in series]
    frequency, power = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    band = np.digitize(frequency, np.geomspace(frequency.min() * 0.99, frequency.max() * 1.01, _BANDS + 1)) - 1
    used = np.unique(band)
    return Spectrum(
        np.array([frequency[band == b].mean() for b in used]),
        np.stack([power[band == b].mean(axis=0) for b in used]),
        np.array([float(np.count_nonzero(band == b)) for b in used]),
    )


def _periodogram(block: FloatArray, seen: BoolArray, step: float) -> tuple[FloatArray, Any]:
    """Return frequencies (f,) [Hz] and cross-periodograms (f, 3, 3) of a tapered series; gaps count as zero."""
    filled = np.zeros((len(seen), 3))
    filled[seen] = block
    window = signal.windows.hann(len(seen), sym=False) * seen
    waves = np.fft.rfft(filled * window[:, None], axis=0)
    power = np.einsum("fi,fj->fij", waves, waves.conj()) * step / np.sum(window**2)
    frequency = np.asarray(np.fft.rfftfreq(len(seen), step), dtype=np.float64)
    inside = (frequency > 0.0) & (frequency < _HIGHEST / step)
    return frequency[inside], power[inside]


def remaining_power(left: NoiseSample) -> FloatArray:
    """Return which share (bands, 3) of the power of white noise is left where columns were taken out, by draws.

    The saturated model explains what is slow better than what is fast; a drift would be taken for smaller than it is.
    """
    rng = np.random.default_rng(0)
    basis = span(left.columns)
    ends = np.cumsum([len(block) for block in left.residuals])[:-1]
    power = np.zeros(2)
    for _ in range(_DRAWS):
        white = rng.standard_normal(len(basis.shared))
        drawn = [
            spectrum(replace(left, residuals=np.split(series.reshape(-1, 3), ends)))
            for series in (white, basis.off(white))
        ]
        power = power + np.stack([np.einsum("bcc->bc", spectra.power).real for spectra in drawn], axis=-1)
    return np.asarray(np.clip(power[..., 1] / power[..., 0], _LEAST, 1.0))
