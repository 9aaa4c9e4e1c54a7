"""Process noise: random forces push the fish off its path, and a camera adds white noise.

    dv' = A(t) dv + a,   a' = -a / tau + sqrt(2 / tau) q w,   v = dv + sigma eps

with A the state Jacobian, the equation of motion linearised along the nominal rollout. A Kalman filter whitens it: its
innovations are those of the one-step predictor x^_{k+1} = F(x^_k + K (y_k - x^_k)) to first order, the innovations form
of the fit ([Ljung1999], sec. 7.4). q, sigma and tau follow from the spectra of the residuals by Whittle's likelihood,
with A averaged over time:

    S(f) = H Q(f) H* + R,   H = (2 pi i f - A)^-1,   Q = 2 q^2 tau / (1 + (2 pi f tau)^2)

[Ljung1999] L. Ljung, System Identification. [Whittle1953] P. Whittle, Arkiv for Matematik 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import linalg, optimize

from mjfish.data import Trial
from mjfish.files.plain_data import unsaved
from mjfish.noise.autoregressive import Noise
from mjfish.noise.kalman import Gains, gains
from mjfish.noise.sample import NoiseSample, Spectrum, spectrum
from mjfish.numerics.arrays import BoolArray, FloatArray, checked, readonly

#: Correlation times that are tried [s].
_TIMES = (0.1, 0.3, 1.0, 3.0)


@dataclass(frozen=True, eq=False)
class ProcessNoise(Noise):
    """Noise through random forces on the fish.

    Attributes:
        sigma: (3,) of the camera [m/s, m/s, rad/s].
        push: (3,) q, standard deviation of the random accelerations [m/s2, m/s2, rad/s2].
        time: tau [s].
        jacobians: by trial name, A (n, 3, 3) [1/s] on the grid of its samples.
    """

    push: FloatArray = field(default_factory=lambda: np.zeros(3))
    time: float = 1.0
    jacobians: Mapping[str, FloatArray] = unsaved(default_factory=dict)
    _cache: dict[tuple[str, bytes], Gains] = unsaved(default_factory=dict)

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filter of a trial, one for all three channels."""
        key = (trial.name, seen.tobytes())
        if key not in self._cache:
            transition, drive, start = self.matrices(self._jacobian(trial, len(seen)), trial.step)
            reading = np.concatenate([np.eye(3), np.zeros((3, 3))], axis=1)
            self._cache[key] = gains(transition, drive[None], reading, self.sigma**2, start, seen)
        return [self._cache[key]]

    def matrices(self, jacobian: FloatArray, step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the transition (n, 6, 6), drive (6, 6) and start (6, 6) of the state (dv, a), for A (n, 3, 3)."""
        joint = np.zeros((len(jacobian), 6, 6))
        joint[:, :3, :3], joint[:, :3, 3:], joint[:, 3:, 3:] = jacobian, np.eye(3), -np.eye(3) / self.time
        drive, start = np.zeros((6, 6)), np.zeros((6, 6))
        drive[3:, 3:] = np.diag(self.push**2 * (1.0 - np.exp(-2.0 * step / self.time)))
        start[3:, 3:] = np.diag(self.push**2)
        return linalg.expm(joint * step), drive, start

    def _jacobian(self, trial: Trial, samples: int) -> FloatArray:
        """Return A of a trial; of one that the noise was not estimated from, the mean of the others."""
        if trial.name in self.jacobians and len(self.jacobians[trial.name]) >= samples:
            return self.jacobians[trial.name][:samples]
        return np.asarray(np.mean([jacobian.mean(axis=0) for jacobian in self.jacobians.values()], axis=0))[None]


def process_noise(left: NoiseSample, jacobians: Mapping[str, FloatArray]) -> ProcessNoise:
    """Estimate process noise from residuals.

    Args:
        left: the residuals.
        jacobians: by trial name, A (n, 3, 3) on the grid of its samples; of other trials, too.
    """
    own = {trial.name: jacobians[trial.name] for trial in left.trials}
    step, seen = left.trials[0].step, spectrum(left)
    mean = np.mean([a.mean(axis=0) for a in own.values()], axis=0)
    spread = np.sqrt(np.mean(np.concatenate(left.residuals) ** 2, axis=0))
    start = np.log(np.concatenate([0.7 * spread, 0.7 * spread * np.abs(np.diag(mean))]))
    options: dict[str, Any] = {"jac": True, "method": "L-BFGS-B", "bounds": [(s - 9.0, s + 4.0) for s in start]}
    found = [(optimize.minimize(_whittle, start, (time, mean, seen, step), **options), time) for time in _TIMES]
    best, time = min(found, key=lambda pair: float(pair[0].fun))
    checked(np.asarray(best.fun))
    return ProcessNoise(readonly(np.exp(best.x[:3])), push=readonly(np.exp(best.x[3:])), time=time, jacobians=own)


def _whittle(x: FloatArray, time: float, mean: FloatArray, seen: Spectrum, step: float) -> tuple[float, FloatArray]:
    """Return minus Whittle's log-likelihood, and its gradient (6,), at logarithms x of both standard deviations."""
    (sigma, push), turn = np.exp(x.reshape(2, 3)), 2.0 * np.pi * seen.frequency
    h = np.linalg.inv(1j * turn[:, None, None] * np.eye(3) - mean)
    q = 2.0 * push**2 * time / (1.0 + (turn[:, None] * time) ** 2)
    density = np.einsum("fij,fj,fkj->fik", h, q, h.conj()) + np.diag(sigma**2) * step
    inverse = np.linalg.inv(density)
    explained = inverse @ seen.power
    value = float(seen.count @ (np.linalg.slogdet(density)[1] + np.einsum("fii->f", explained).real))
    slopes = inverse - explained @ inverse
    white = 2.0 * sigma**2 * step * (seen.count @ np.einsum("fcc->fc", slopes).real)
    pushed = 2.0 * seen.count @ (q * np.einsum("fij,fik,fkj->fj", h.conj(), slopes, h).real)
    return value, np.concatenate([white, pushed])
