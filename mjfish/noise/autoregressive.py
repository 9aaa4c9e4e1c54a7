"""The base of all noise models, and autoregressive noise: estimated by Yule-Walker, whitened exactly, forecast.

    e_t = sum_k phi_k e_{t-k} + sigma eps_t,   eps white with variance 1

No sample is given up for a past that was not seen, and gaps are passed over: a Kalman filter over the companion form
starts from the stationary covariance. Its forecast v_{t+k|t} = (F^k s_{t|t})_1 is the conditional mean given every
sample up to t ([Ljung1999], ch. 3.2; [Jones1980] on gaps). White noise is of order 0.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import linalg

from mjfish.data import Trial
from mjfish.data.trial import rows_of, seen_of
from mjfish.errors import InputError
from mjfish.files.plain_data import fields_of
from mjfish.noise.kalman import Gains, filtered_states, gains, whitened
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly

#: Highest autoregressive order that is tried (0.4 s at 50 Hz).
MAX_ORDER = 20
#: Share of the variance that is treated as white whatever the data say: keeps zeros of the spectrum from ruling.
WHITE_FLOOR = 2e-3
#: Smallest sigma that is believed, as a share of the range of a channel.
FLOOR = 5e-4


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the measured velocities of a trial: surge [m/s], sway [m/s], yaw rate [rad/s].

    A subclass gives the Kalman filters of a trial (`filters`), one for each channel or one for all three; whitening
    and likelihood follow from them.

    Attributes:
        sigma: (3,) standard deviation of the innovations, or of the white part.
        phi: (3, p) autoregressive coefficients; p = 0 for other kinds of noise.
    """

    sigma: FloatArray
    phi: FloatArray = field(default_factory=lambda: readonly(np.zeros((3, 0))))

    @staticmethod
    def white(sigma: FloatArray) -> Autoregressive:
        """Return white noise of standard deviations (3,)."""
        return Autoregressive(readonly(sigma))

    @property
    def order(self) -> int:
        """Autoregressive order p."""
        return int(self.phi.shape[1])

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of a trial whose samples are there where `seen` (n,) on a grid of equal steps."""
        raise NotImplementedError

    def whiten(self, trial: Trial, mask: BoolArray, block: FloatArray) -> FloatArray:
        """Whiten columns of one trial, residuals or sensitivities.

        Args:
            trial: that they belong to.
            mask: (samples,) which of its samples count.
            block: (n, 3, ...) a row a counted sample, channels second.

        Returns:
            (n, 3, ...) innovations of residuals, white and of unit variance where the model holds.
        """
        seen = grid(trial.time, mask)
        filters = self.filters(trial, seen)
        parts = np.split(block.reshape(len(block), 3, -1), len(filters), axis=1)
        return np.concatenate(
            [whitened(filter_, seen, part) for filter_, part in zip(filters, parts, strict=True)], axis=1
        ).reshape(block.shape)

    def log_determinant(self, trial: Trial, mask: BoolArray) -> float:
        """Return the log determinant of the noise's covariance on the counted samples of a trial."""
        return sum(filter_.log_determinant for filter_ in self.filters(trial, grid(trial.time, mask)))

    def to_dict(self) -> dict[str, Any]:
        """Return kind and numbers as plain data; `mjfish.estimation.noise_of_fit.restore` reads them."""
        return {"kind": type(self).__name__, **fields_of(self)}


@dataclass(frozen=True, eq=False)
class Autoregressive(Noise):
    """Noise v_t = sum_k phi_k v_{t-k} + sigma eps_t in every channel; white where the order is 0."""

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of the channels."""
        return [
            _filter(phi.tobytes(), float(sigma), seen.tobytes())
            for phi, sigma in zip(self.phi, self.sigma, strict=True)
        ]

    def whiten(self, trial: Trial, mask: BoolArray, block: FloatArray) -> FloatArray:
        """Whiten columns (n, 3, ...) of the counted samples of a trial."""
        if self.order == 0:  # of every fit of coefficients: no filter is needed
            return np.asarray(block / self.sigma.reshape(1, 3, *[1] * (block.ndim - 2)))
        return super().whiten(trial, mask, block)

    def forecasts(self, residual: FloatArray, horizons: Sequence[int]) -> dict[int, FloatArray]:
        """Return forecasts of a residual from what was measured so many samples and more before.

        Args:
            residual: (m, 3) on a grid of equal steps, NaN in gaps.
            horizons: numbers of samples k, each at least 1.

        Returns:
            (m, 3) by horizon; zero, its mean, for the first k samples, which have nothing to look back on.

        Raises:
            InputError: a horizon is below 1, or the noise is not stationary.
        """
        if any(steps < 1 for steps in horizons):
            raise InputError(f"a forecast {min(horizons)} samples ahead, expected 1 or more; correct the horizon")
        ahead = {steps: np.zeros_like(residual) for steps in horizons}
        for c, series in enumerate(residual.T if self.order else ()):
            filter_ = _filter(self.phi[c].tobytes(), float(self.sigma[c]), np.isfinite(series).tobytes())
            states = filtered_states(filter_, np.nan_to_num(series)[:, None])
            for steps, forecast in ahead.items():
                row = np.linalg.matrix_power(filter_.transition.at(0), steps)[0]
                forecast[steps:, c] = states[: max(len(states) - steps, 0)] @ row
        return ahead


def grid(time: FloatArray, mask: BoolArray) -> BoolArray:
    """Return, on a grid of equal steps from the first sample to the last counted one, whether one is counted there."""
    return seen_of(rows_of(time)[mask])


@functools.lru_cache(maxsize=1024)
def _filter(phi: bytes, sigma: float, seen: bytes) -> Gains:
    """Make the filter of one channel; that of white noise has a state that is nought."""
    rates = np.frombuffer(phi) if phi else np.zeros(1)
    transition = linalg.companion([1.0, *-rates])
    if np.max(np.abs(linalg.eigvals(transition))) >= 1.0:
        raise InputError(f"autoregressive noise {rates.tolist()} grows without bound; give a stationary one")
    drive = np.diag([sigma**2, *np.zeros(len(rates) - 1)])
    start = readonly(linalg.solve_discrete_lyapunov(transition, drive))
    there = np.frombuffer(seen, dtype=np.bool_)
    return gains(transition[None], drive[None], np.eye(1, len(rates)), np.zeros(1), start, there)


def floor(trials: Sequence[Trial]) -> FloatArray:
    """Return the smallest sigma (3,) that is believed of data that state none: 5e-4 of each channel's range.

    No camera is better, and data without any noise would else be judged by the rounding of the integrator. NaN of a
    channel that no trial measured.
    """
    every = np.concatenate([trial.velocity for trial in trials])
    return np.asarray(FLOOR * (np.fmax.reduce(every) - np.fmin.reduce(every)) + 1e-9)


def estimate(
    residuals: Sequence[FloatArray], lost: float = 0.0, seen: Sequence[BoolArray] | None = None
) -> Autoregressive:
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
    if seen is not None and not all(there.all() for there in seen):
        products = _with_gaps(residuals, seen, highest)
    return by_order(products * inflate, total)


def _with_gaps(residuals: Sequence[FloatArray], seen: Sequence[BoolArray], highest: int) -> FloatArray:
    """Return autocovariances (3, highest + 1) from the pairs that are there, tapered as without gaps."""
    products, pairs = products_and_pairs(residuals, seen, highest)
    all_pairs = np.array([sum(max(len(there) - k, 0) for there in seen) for k in range(highest + 1)])
    covariances: FloatArray = products / np.maximum(pairs, 1.0) * all_pairs / all_pairs[0]
    for row in covariances:  # pairs that are missing may leave it indefinite
        row[0] += max(1e-3 * row[0] - float(np.linalg.eigvalsh(linalg.toeplitz(row))[0]), 0.0)
    return covariances


def products_and_pairs(
    blocks: Sequence[FloatArray], seen: Sequence[BoolArray], highest: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums of lagged products (c, highest + 1) of blocks (m, c) with gaps, and how many products are there.

    Args:
        blocks: of zero mean.
        seen: per block, on a grid of equal steps, where its rows stand.
        highest: lag.
    """
    filled = [np.zeros((len(there), block.shape[1])) for there, block in zip(seen, blocks, strict=True)]
    for on_grid, there, values in zip(filled, seen, blocks, strict=True):
        on_grid[there] = values
    counted = [there.astype(np.float64)[:, None] for there in seen]
    return lagged_products(filled, highest), lagged_products(counted, highest)[0]


def highest_order(lengths: Sequence[int]) -> int:
    """Return the highest order to try: of the longest run an eighth, and half of the shortest, which loses so much."""
    return max(min(MAX_ORDER, max(lengths) // 8, min(lengths) // 2), 0)


def lagged_products(blocks: Sequence[FloatArray], highest: int) -> FloatArray:
    """Return the sums of lagged products (c, highest + 1) of zero-mean blocks (m, c), lags 0..highest."""
    lags = range(highest + 1)
    return np.array(
        [[sum(b[k:, c] @ b[: len(b) - k, c] for b in blocks) for k in lags] for c in range(blocks[0].shape[1])],
        dtype=float,
    )


def by_order(covariances: FloatArray, total: int) -> Autoregressive:
    """Solve the Yule-Walker equations of the autocovariances of every channel, order by BIC.

    Args:
        covariances: (c, h + 1) of the channels, lags 0..h; orders up to h are tried.
        total: samples that they were estimated from.
    """
    fits = [[_yule_walker(row, p) for row in covariances] for p in range(covariances.shape[1])]
    cost = [sum(total * np.log(s) for _, s in row) + len(row) * p * np.log(total) for p, row in enumerate(fits)]
    chosen = fits[int(np.argmin(cost))]
    return Autoregressive(readonly(np.sqrt([s for _, s in chosen])), readonly(np.stack([phi for phi, _ in chosen])))


def _yule_walker(covariance: FloatArray, order: int) -> tuple[FloatArray, float]:
    """Return phi (order,) and the innovations' variance."""
    later = covariance[1 : order + 1]
    floored = np.maximum(covariance[:1] * (1.0 + (WHITE_FLOOR if order else 0.0)), 1e-300)
    phi = linalg.solve_toeplitz(np.append(floored, later[:-1]), later) if order else later
    return phi, max(float(floored[0] - phi @ later), 1e-300)
