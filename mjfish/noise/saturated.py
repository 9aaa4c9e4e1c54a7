"""Noise seen through the saturated model: what is left when the coefficients and every candidate are taken out.

Estimating the noise from the residual of the baseline would count the effect as noise; the saturated residual does not,
to first order (docs/notes/004).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import linalg

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data import Trial
from mjfish.estimation import Fit, Noise, Problem, algebra
from mjfish.estimation.basis import omnibus
from mjfish.noise.coloured import grid
from mjfish.noise.spectrum import spectrum

#: Draws of white noise that tell what the saturated model takes of a spectrum, and the least share that is left.
_DRAWS, _LEAST = 16, 0.02


class Whitening(Protocol):
    """What a model of the noise does to columns (n, 3, ...) of a trial, and the determinant that belongs to it."""

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...), one row a counted sample."""
        ...

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        ...


@dataclass(frozen=True, eq=False)
class Saturated:
    """What the saturated model leaves, in physical units.

    Attributes:
        residuals: (n_r, 3) per trial.
        span: (n_r, 3, k) per trial, of what it explains; as columns over all trials divided by sigma, orthonormal.
        lost: degrees of freedom per channel that it took.
    """

    residuals: list[FloatArray]
    span: list[FloatArray]
    lost: float

    @property
    def free(self) -> float:
        """Degrees of freedom per channel that are left."""
        return sum(len(block) for block in self.residuals) - self.lost

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation (3,) of the channels."""
        return np.asarray(np.sqrt(sum((block**2).sum(axis=0) for block in self.residuals) / self.free))

    def of(self, trials: Sequence[int]) -> Saturated:
        """Return that of some trials, which take their share of the freedom."""
        count, total = (sum(len(self.residuals[i]) for i in which) for which in (trials, range(len(self.residuals))))
        residuals, span = ([block[i] for i in trials] for block in (self.residuals, self.span))
        return Saturated(residuals, span, self.lost * count / total)


def saturated(problem: Problem, fit: Fit, known: Sequence[FloatArray]) -> Saturated:
    """Return residuals without anything that the saturated model explains; it weighs channels by sigma alone."""
    white = replace(problem, noise=Noise.white(problem.noise.sigma))
    jacobian = white.whiten(white.sensitivities(fit.x))[:, ~fit.at_bound]
    return _left(problem, problem.raw(fit.x), np.concatenate([jacobian, white.whiten(known)], axis=1))


def without(problem: Problem, left: Saturated, columns: FloatArray) -> Saturated:
    """Take further columns (3 n, k), divided by sigma, out of what is left: `levels` or `shapes`."""
    rest = _left(problem, left.residuals, np.concatenate([_columns(problem, left), columns], axis=1))
    return replace(rest, lost=left.lost + (rest.span[0].shape[2] - left.span[0].shape[2]) / 3.0)


def levels(problem: Problem) -> FloatArray:
    """Return the columns (3 n, 3 runs) of a level of every channel of every run."""
    counts = [int(np.count_nonzero(problem.mask(i))) for i in range(len(problem.trials))]
    return np.asarray(linalg.block_diag(*[np.tile(np.eye(3), (count, 1)) for count in counts]))


def shapes(problem: Problem) -> FloatArray:
    """Return the columns (3 n, k) of every function of the omnibus basis, the same in all runs, channel by channel."""
    rows = []
    for i, blocks in enumerate(omnibus(problem.model.fish.cpg, problem.trials)):
        waves = np.concatenate(blocks, axis=2)[problem.mask(i)]
        rows.append(waves.reshape(3 * len(waves), -1))
    return np.concatenate(rows)


def _left(problem: Problem, residuals: Sequence[FloatArray], columns: FloatArray) -> Saturated:
    """Take columns (3 n, k), divided by sigma, out of residuals (n_r, 3) of the trials."""
    sigma, ends = problem.noise.sigma, np.cumsum([len(block) for block in residuals])[:-1]
    span = algebra.orthonormal(columns)
    scaled = np.concatenate([(block / sigma).ravel() for block in residuals])
    left = algebra.project_out(span, scaled[:, None])[:, 0].reshape(-1, 3) * sigma
    explained = span.reshape(len(left), 3, -1) * sigma[:, None]
    return Saturated(np.split(left, ends), np.split(explained, ends), span.shape[1] / 3.0)


def _columns(problem: Problem, left: Saturated) -> FloatArray:
    """Return the columns (3 n, k) that were taken out, divided by sigma."""
    scaled = [block / problem.noise.sigma[:, None] for block in left.span]
    return np.concatenate([block.reshape(3 * len(block), -1) for block in scaled])


def kept(problem: Problem, left: Saturated) -> FloatArray:
    """Return which share (bands, 3) of the power of white noise the saturated model leaves, band by band.

    It explains what is slow better than what is fast; a drift would be taken for smaller than it is. By draws.
    """
    rng = np.random.default_rng(0)
    basis = algebra.orthonormal(_columns(problem, left))
    ends = np.cumsum([len(block) for block in left.residuals])[:-1]
    power = np.zeros(2)
    for _ in range(_DRAWS):
        white = rng.standard_normal(len(basis))
        both = (white, white - basis @ (basis.T @ white))
        power = power + np.stack(
            [np.einsum("bcc->bc", spectrum(problem, np.split(one.reshape(-1, 3), ends)).power).real for one in both],
            axis=-1,
        )
    return np.asarray(np.clip(power[..., 1] / power[..., 0], _LEAST, 1.0))


def likelihood(noise: Whitening, problem: Problem, left: Saturated) -> float:
    """Return the restricted log-likelihood of what the saturated model leaves, less a constant.

    -1/2 (r' V^-1 r - r' V^-1 X (X' V^-1 X)^-1 X' V^-1 r + log det V + log det X' V^-1 X)  [Patterson1971]

    with the covariance V of the noise and the columns X of the saturated model: what these explain of a slow noise is
    no evidence against it.

    [Patterson1971] H. Patterson and R. Thompson, Biometrika 58.
    """
    z, r = _whitened(noise, problem, left)
    total = sum(
        noise.log_determinant(trial, grid(trial.time, problem.mask(i))) for i, trial in enumerate(problem.trials)
    )
    return float(-0.5 * (total + np.sum(z**2)) - np.sum(np.log(np.abs(np.diag(r)))))


def spread(noise: Whitening, problem: Problem, left: Saturated) -> FloatArray:
    """Return the standard deviations (3,) of the whitened residual beyond the saturated model: 1 of the true noise."""
    z, r = _whitened(noise, problem, left)
    return np.asarray(np.sqrt(np.sum(z**2, axis=0) / (len(z) - len(r) / 3.0)))


def _whitened(noise: Whitening, problem: Problem, left: Saturated) -> tuple[FloatArray, FloatArray]:
    """Return the whitened residual (n, 3) less its part in the whitened columns, and R (k, k) of these."""
    white, columns = [], []
    for i, (trial, block, span) in enumerate(zip(problem.trials, left.residuals, left.span, strict=True)):
        both = noise.of_trial(trial, problem.mask(i), np.concatenate([block[:, :, None], span], axis=2), (0,))
        white.append(both[:, :, 0].ravel())
        columns.append(both[:, :, 1:].reshape(len(white[-1]), -1))
    z, x = np.concatenate(white), np.concatenate(columns)
    q, r = np.linalg.qr(x[:, np.linalg.norm(x, axis=0) > 0.0])
    return (z - q @ (q.T @ z)).reshape(-1, 3), r
