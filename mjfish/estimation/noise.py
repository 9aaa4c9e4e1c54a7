"""Noise of the measured velocities: white or autoregressive, per channel; and the whitening filter it implies.

    e_t = sum_k phi_k e_{t-k} + sigma eps_t,   eps white with variance 1

so that (e_t - sum_k phi_k e_{t-k}) / sigma is white. The first p samples of a trial have no full past and are dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, signal

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.serialise import fields_of

#: Highest autoregressive order that is tried (0.4 s at 50 Hz).
MAX_ORDER = 20
#: Share of the variance that is treated as white whatever the data say: keeps zeros of the spectrum from ruling.
WHITE_FLOOR = 2e-3
_FLOOR = 5e-4


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise model of the three channels.

    Attributes:
        sigma: (3,) standard deviation of the innovations [m/s, m/s, rad/s].
        phi: (3, p) autoregressive coefficients; p = 0 is white noise.
    """

    sigma: FloatArray
    phi: FloatArray

    @staticmethod
    def white(sigma: FloatArray) -> Noise:
        """Return white noise of standard deviations (3,)."""
        return Noise(readonly(sigma), readonly(np.zeros((3, 0))))

    @property
    def order(self) -> int:
        """Autoregressive order p."""
        return int(self.phi.shape[1])

    def whiten(self, block: FloatArray, starts: Sequence[int] = (0,)) -> FloatArray:
        """Whiten columns that belong to one trial.

        Args:
            block: (n, 3, ...) residuals or sensitivities, channels second.
            starts: rows at which a stretch of equally spaced times begins; the first p rows of each are dropped.

        Returns:
            (m, 3, ...), of unit variance and white where the model holds; m = n - p where there is one stretch.
        """
        pieces = np.split(block, list(starts)[1:])
        return np.concatenate([self._whiten(piece) for piece in pieces])

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Whiten columns (n, 3, ...) of a trial's counted samples; noise that knows more of a trial overrides it."""
        del trial, mask
        return self.whiten(block, starts)

    def to_dict(self) -> dict[str, Any]:
        """Return kind and numbers as plain data; `mjfish.noise.restore` reads them."""
        return {"kind": type(self).__name__, **fields_of(self)}

    def _whiten(self, block: FloatArray) -> FloatArray:
        whitened = [
            signal.lfilter(
                np.concatenate([[1.0], -self.phi[channel]]), [self.sigma[channel]], block[:, channel], axis=0
            )
            for channel in range(3)
        ]
        return np.asarray(np.stack(whitened, axis=1)[self.order :])


def floor(trials: Sequence[Trial]) -> FloatArray:
    """Return the smallest sigma (3,) that is believed of data that state none: 5e-4 of each channel's range.

    No camera is better, and data without any noise would else be judged by the rounding of the integrator.
    """
    return np.asarray(_FLOOR * np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0) + 1e-9)


def estimate(residuals: Sequence[FloatArray], lost: float = 0.0, seen: Sequence[BoolArray] | None = None) -> Noise:
    """Estimate the noise from residuals (n_r, 3) of several trials by Yule-Walker equations, order by BIC.

    Args:
        residuals: one array a trial.
        lost: degrees of freedom per channel that went into making them residuals.
        seen: per trial, on a grid of equal steps, where its rows stand; None: there is no gap.
    """
    total = sum(len(block) for block in residuals)
    inflate = total / max(total - lost, 0.1 * total)
    highest = highest_order([len(block) for block in residuals])
    # Divided by the same number at every lag: biased, which keeps the Toeplitz matrix positive.
    products = lagged_products(residuals, highest) / total
    if seen is not None and any(not there.all() for there in seen):
        products = _with_gaps(residuals, seen, highest)
    return by_order(products * inflate, total)


def _with_gaps(residuals: Sequence[FloatArray], seen: Sequence[BoolArray], highest: int) -> FloatArray:
    """Return autocovariances (3, highest + 1) from the pairs that are there, tapered as without gaps."""
    filled = [np.zeros((len(there), 3)) for there in seen]
    for block, there, values in zip(filled, seen, residuals, strict=True):
        block[there] = values
    pairs = np.array(
        [sum(float(there[k:] @ there[: len(there) - k]) for there in map(_real, seen)) for k in range(highest + 1)]
    )
    whole = np.array([sum(max(len(there) - k, 0) for there in seen) for k in range(highest + 1)])
    covariances: FloatArray = lagged_products(filled, highest) / np.maximum(pairs, 1.0) * whole / whole[0]
    for row in covariances:  # pairs that are missing may leave it indefinite
        row[0] += max(1e-3 * row[0] - float(np.linalg.eigvalsh(linalg.toeplitz(row))[0]), 0.0)
    return covariances


def _real(there: BoolArray) -> FloatArray:
    return there.astype(np.float64)


def highest_order(lengths: Sequence[int]) -> int:
    """Return the highest order to try: of the longest run an eighth, and half of the shortest, which loses so much."""
    return max(min(MAX_ORDER, max(lengths) // 8, min(lengths) // 2), 0)


def lagged_products(blocks: Sequence[FloatArray], highest: int) -> FloatArray:
    """Return the sums of lagged products (3, highest + 1) of zero-mean blocks (m, 3), lags 0..highest."""
    lags = range(highest + 1)
    return np.array([[sum(b[k:, c] @ b[: len(b) - k, c] for b in blocks) for k in lags] for c in range(3)], dtype=float)


def by_order(covariances: FloatArray, total: int) -> Noise:
    """Solve the Yule-Walker equations of the autocovariances of every channel, order by BIC.

    Args:
        covariances: (3, h + 1), lags 0..h; orders up to h are tried.
        total: samples that they were estimated from.
    """
    fits = [[_yule_walker(row, p) for row in covariances] for p in range(covariances.shape[1])]
    cost = [sum(total * np.log(s) for _, s in row) + 3 * p * np.log(total) for p, row in enumerate(fits)]
    chosen = fits[int(np.argmin(cost))]
    return Noise(readonly(np.sqrt([s for _, s in chosen])), readonly(np.stack([phi for phi, _ in chosen])))


def _yule_walker(covariance: FloatArray, order: int) -> tuple[FloatArray, float]:
    """Return phi (order,) and the innovations' variance."""
    floored = covariance.copy()
    floored[0] = max(floored[0] * (1.0 + (WHITE_FLOOR if order else 0.0)), 1e-300)
    if order == 0:
        return np.zeros(0), float(floored[0])
    phi = linalg.solve_toeplitz(floored[:order], floored[1 : order + 1])
    return phi, float(max(floored[0] - phi @ floored[1 : order + 1], 1e-300))
