"""Noise that comes through the water: random forces push the fish off its path, and a camera adds white noise.

    dv' = A(t) dv + a,   a' = -a / tau + sqrt(2 / tau) q w,   v = dv + sigma eps

with A the linearised equation of motion along the nominal rollout. A Kalman filter whitens it: its innovations are
those of the one-step predictor x^_{k+1} = F(x^_k + K (y_k - x^_k)) to first order, the innovations form of the fit
([Ljung1999], sec. 7.4). q, sigma and tau follow from the spectra of the residuals by Whittle's likelihood, with A
averaged over time:

    S(f) = H Q(f) H* + R,   H = (2 pi i f - A)^-1,   Q = 2 q^2 tau / (1 + (2 pi f tau)^2)

[Ljung1999] L. Ljung, System Identification. [Whittle1953] P. Whittle, Arkiv for Matematik 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, optimize

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.estimation import Fit, Noise, Problem
from mjfish.noise.coloured import grid
from mjfish.noise.kalman import Gains, gains, whitened
from mjfish.noise.spectrum import Spectrum, spectrum
from mjfish.ode.jacobians import state_jacobian
from mjfish.serialise import unsaved

#: Correlation times that are tried [s].
_TIMES = (0.1, 0.3, 1.0, 3.0)


@dataclass(frozen=True, eq=False)
class Pushed(Noise):
    """Noise through forces on the fish.

    Attributes:
        sigma: (3,) of the camera [m/s, m/s, rad/s]; `phi` is empty.
        push: (3,) q, standard deviation of the random accelerations [m/s2, m/s2, rad/s2].
        time: tau [s].
        growth: by trial name, A (n, 3, 3) on the grid of its samples.
    """

    push: FloatArray = field(default_factory=lambda: np.zeros(3))
    time: float = 1.0
    growth: Mapping[str, FloatArray] = unsaved(default_factory=dict)
    made: dict[tuple[str, bytes], Gains] = unsaved(default_factory=dict)

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...) of columns (n, 3, ...), one row a counted sample."""
        del starts
        seen = grid(trial.time, mask)
        return whitened(self.filter(trial, seen), seen, block.reshape(len(block), 3, -1)).reshape(block.shape)

    def filter(self, trial: Trial, seen: BoolArray) -> Gains:
        """Return the Kalman filter of a trial."""
        key = (trial.name, seen.tobytes())
        if key not in self.made:
            step = trial.step
            self.made[key] = _filter(self._growth(trial, len(seen)), step, self, seen)
        return self.made[key]

    def matrices(self, growing: FloatArray, step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the transition (n, 6, 6), drive (6, 6) and start (6, 6) of the state (dv, a), for A (n, 3, 3)."""
        whole = np.zeros((len(growing), 6, 6))
        whole[:, :3, :3], whole[:, :3, 3:], whole[:, 3:, 3:] = growing, np.eye(3), -np.eye(3) / self.time
        drive, start = np.zeros((6, 6)), np.zeros((6, 6))
        drive[3:, 3:] = np.diag(self.push**2 * (1.0 - np.exp(-2.0 * step / self.time)))
        start[3:, 3:] = np.diag(self.push**2)
        return linalg.expm(whole * step), drive, start

    def numbers(self) -> FloatArray:
        """Return all numbers of the model (7,)."""
        return np.concatenate([self.sigma, self.push, [self.time]])

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        return self.filter(trial, seen).log_determinant

    def _growth(self, trial: Trial, samples: int) -> FloatArray:
        """Return A of a trial; of one that the noise was not made for, the mean of the others."""
        if trial.name in self.growth and len(self.growth[trial.name]) >= samples:
            return self.growth[trial.name][:samples]
        return np.asarray(np.mean([one.mean(axis=0) for one in self.growth.values()], axis=0))[None]


def _filter(growing: FloatArray, step: float, noise: Pushed, seen: BoolArray) -> Gains:
    """Make the filter of one series of samples."""
    transition, drive, start = noise.matrices(growing, step)
    reading = np.concatenate([np.eye(3), np.zeros((3, 3))], axis=1)
    return gains(transition, drive[None], reading, np.diag(noise.sigma**2), start, seen)


def along(problem: Problem, values: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return A on the grid of the samples of every trial at some values of the parameters."""
    result = {}
    for i, trial in enumerate(problem.trials):
        run = problem.model.prepare(trial, values)
        rollout = problem.prediction(trial, values).rollout
        a = state_jacobian(run.fish, rollout, values=run.coefficients, loads=run.loads)
        mask = problem.mask(i)
        step = trial.step
        first, count = float(trial.time[0]), len(grid(trial.time, mask))
        at = np.clip(np.searchsorted(rollout.time, first + step * np.arange(count)), 0, len(a) - 1)
        result[trial.name] = readonly(a[at])
    return result


def pushed(problem: Problem, fit: Fit, residuals: Sequence[FloatArray]) -> Pushed:
    """Estimate force noise from residuals (n_r, 3) of the trials of a fit."""
    growing = along(problem, fit.values)
    step = problem.trials[0].step
    seen = spectrum(problem, residuals)
    mean = np.mean([a.mean(axis=0) for a in growing.values()], axis=0)
    spread = np.sqrt(np.mean(np.concatenate([block**2 for block in residuals]), axis=0))
    best: tuple[float, FloatArray, float] | None = None
    for time in _TIMES:
        start = np.log(np.concatenate([0.7 * spread, 0.7 * spread * np.abs(np.diag(mean))]))

        def cost(x: FloatArray, time: float = time) -> float:
            return _whittle(np.exp(x[:3]), np.exp(x[3:]), time, mean, seen, step)

        found = optimize.minimize(cost, start, method="L-BFGS-B", bounds=[(s - 9.0, s + 4.0) for s in start])
        if best is None or found.fun < best[0]:
            best = (float(found.fun), np.asarray(found.x), time)
    assert best is not None  # noqa: S101 - there are times to try
    return Pushed(
        readonly(np.exp(best[1][:3])), readonly(np.zeros((3, 0))), readonly(np.exp(best[1][3:])), best[2], growing
    )


def _whittle(sigma: FloatArray, push: FloatArray, time: float, mean: FloatArray, seen: Spectrum, step: float) -> float:
    """Return minus Whittle's log-likelihood."""
    turn = 2.0 * np.pi * seen.frequency
    h = np.linalg.inv(1j * turn[:, None, None] * np.eye(3) - mean)
    q = 2.0 * push**2 * time / (1.0 + (turn[:, None] * time) ** 2)
    density = np.einsum("fij,fj,fkj->fik", h, q, h.conj()) + np.diag(sigma**2) * step
    misfit = np.einsum("fij,fji->f", np.linalg.inv(density), seen.power).real
    return float(seen.count @ (np.linalg.slogdet(density)[1] + misfit))
