"""Errors in variables: measured joint angles have errors, so the simulated fish moved otherwise than the real one.

    y - y^ = e + sum_m a_m h_m,   a_m ~ N(0, 1)

with e the noise of the velocities and h_m (n, 3) the loading of mode m of the errors: what it does to the velocities.
With the h_m whitened as e is, H = Q S V', rows are made white by

    (I + H H')^(-1/2) = I + Q ((1 + S^2)^(-1/2) - 1) Q'
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mjfish.data import Trial
from mjfish.files.plain_data import unsaved
from mjfish.noise.autoregressive import Noise
from mjfish.numerics.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class ErrorsInVariables(Noise):
    """Noise of velocities that were predicted from joint angles with errors.

    Attributes:
        sigma, phi: of the noise of the velocities.
        base: that noise.
        loadings: gives h (n, 3, modes) of a trial, all samples.
    """

    base: Noise = field(kw_only=True)
    loadings: Callable[[Trial], FloatArray] = unsaved(kw_only=True)
    _cache: dict[tuple[str, bytes], tuple[FloatArray, ...]] = unsaved(default_factory=dict)

    @staticmethod
    def of(base: Noise, loadings: Callable[[Trial], FloatArray]) -> ErrorsInVariables:
        """Return noise `base` with errors of the angles on top."""
        return ErrorsInVariables(base.sigma, base.phi, base=base, loadings=loadings)

    def whiten(self, trial: Trial, mask: BoolArray, block: FloatArray) -> FloatArray:
        """Whiten columns (n, 3, ...) of the counted samples of a trial."""
        white = self.base.whiten(trial, mask, block)
        basis, values, _ = self._span(trial, mask)
        rows = white.reshape(len(basis), -1)
        shrink = 1.0 / np.sqrt(1.0 + values**2) - 1.0
        return np.asarray((rows + basis @ (shrink[:, None] * (basis.T @ rows))).reshape(white.shape))

    def log_determinant(self, trial: Trial, mask: BoolArray) -> float:
        """Return the log determinant of the covariance on the counted samples of a trial."""
        return self.base.log_determinant(trial, mask) + float(np.sum(np.log1p(self._span(trial, mask)[1] ** 2)))

    def cleared(self, trial: Trial, mask: BoolArray, block: FloatArray) -> tuple[FloatArray, float]:
        """Return residuals (n, 3) less the likeliest errors of the angles, and the degrees of freedom that these took.

        The likeliest a are those of the largest posterior, a = (I + H'H)^-1 H' z.
        """
        basis, values, turn = self._span(trial, mask)
        white = self.base.whiten(trial, mask, block).ravel()
        shrink = 1.0 / (1.0 + values**2)
        likeliest = turn.T @ (values * shrink * (basis.T @ white))
        return np.asarray(block - self.loadings(trial)[mask] @ likeliest), float(np.sum(1.0 - shrink))

    def _span(self, trial: Trial, mask: BoolArray) -> tuple[FloatArray, ...]:
        """Return Q (rows, k), S (k,) and V' (k, modes) of the whitened loadings."""
        key = (trial.name, mask.tobytes())
        if key not in self._cache:
            white = self.base.whiten(trial, mask, self.loadings(trial)[mask])
            self._cache[key] = tuple(np.linalg.svd(white.reshape(-1, white.shape[-1]), full_matrices=False))
        return self._cache[key]
