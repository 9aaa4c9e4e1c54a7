"""Autoregressive noise whitened exactly: no sample is given up for a past that was not seen, gaps are passed over."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from scipy import linalg

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.data.trial import rows_of, seen_of
from mjfish.estimation import Noise
from mjfish.noise.kalman import Gains, gains, whitened_channels


class Coloured(Noise):
    """Noise v_t = sum_k phi_k v_{t-k} + sigma eps_t, by a Kalman filter over its companion form.

    The attributes are those of `mjfish.estimation.Noise`; whitening keeps every sample (`order` of them are dropped by
    the plain filter).
    """

    @staticmethod
    def of(noise: Noise) -> Coloured:
        """Return the same noise, whitened exactly."""
        return Coloured(noise.sigma, noise.phi)

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...) of columns (n, 3, ...), one row a counted sample."""
        del starts
        if self.phi.shape[1] == 0:
            return np.asarray(block / self.sigma.reshape(1, 3, *[1] * (block.ndim - 2)))
        seen = grid(trial.time, mask)
        there = seen.tobytes()
        filters = [_filter(self.phi[c].tobytes(), float(self.sigma[c]), there) for c in range(3)]
        return whitened_channels(filters, seen, block)

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        del trial
        if self.phi.shape[1] == 0:
            return float(np.count_nonzero(seen) * np.sum(np.log(self.sigma**2)))
        there = seen.tobytes()
        return sum(_filter(self.phi[c].tobytes(), float(self.sigma[c]), there).log_determinant for c in range(3))


def grid(time: FloatArray, mask: BoolArray) -> BoolArray:
    """Return, on a grid of equal steps from the first sample to the last counted one, whether one is counted there."""
    return seen_of(rows_of(time)[mask])


@functools.lru_cache(maxsize=1024)
def _filter(phi: bytes, sigma: float, seen: bytes) -> Gains:
    rates = np.frombuffer(phi)
    transition = linalg.companion([1.0, *-rates])
    drive = np.zeros_like(transition)
    drive[0, 0] = sigma**2
    reading = np.eye(1, len(rates))
    start = linalg.solve_discrete_lyapunov(transition, drive)
    return gains(
        transition[None], drive[None], reading, np.zeros((1, 1)), readonly(start), np.frombuffer(seen, dtype=np.bool_)
    )
