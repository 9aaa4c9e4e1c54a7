"""Residuals under the null: noise of a known kind, less what a fit of the coefficients takes out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from changed_fit import having
from scipy import signal
from synthetic_swimming import SIGMA, TRUTH, problem, swimming

from mjfish.estimation import Fit, Problem
from mjfish.estimation.fit import Linearised, covariance
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray


def coloured(rng: np.random.Generator, samples: int, phi: float) -> FloatArray:
    """Draw first-order autoregressive noise (samples, 3) with innovations of SIGMA."""
    white = rng.standard_normal((samples + 200, 3)) * SIGMA
    return np.asarray(signal.lfilter([1.0], [1.0, -phi], white, axis=0)[200:])


def at(posed: Problem, x: FloatArray) -> Fit:
    """Return a fit that ended at `x`, whatever the data say."""
    jacobian, free = posed.jacobian(x), np.zeros(len(x), dtype=np.bool_)
    spread = covariance(jacobian, free)
    whitened = posed.residual(x)
    return Fit(
        x, np.zeros(0), free, "converged", "", 1, np.nan, posed.parameters, float(whitened @ whitened),
        lambda: whitened, lambda: Linearised(jacobian, spread), np.sqrt(np.diag(spread)),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Draws:
    """A linearised fit of noise-free trials, drawn from again and again."""

    problem: Problem
    fit: Fit

    def drawn(self, rng: np.random.Generator, phi: float, hidden: dict[int, FloatArray] | None = None) -> Fit:
        """Draw noise, fit it (to first order, as the weights of the problem say), and return what is left, as a fit.

        Args:
            rng: to draw from.
            phi: of the noise.
            hidden: what is added to the noise of some trials, (n, 3) by their index.
        """
        noises = [coloured(rng, len(trial.time), phi) for trial in self.problem.trials]
        for index, more in (hidden or {}).items():
            noises[index] = noises[index] + more
        masks = [self.problem.mask(i) for i in range(len(noises))]
        white = np.concatenate([(e[mask] / SIGMA).ravel() for e, mask in zip(noises, masks, strict=True)])
        return having(self.fit, residual=self.fit.jacobian.factors.basis.off(white))


def draws(fish: Fish, modes: tuple[str, ...] = ("v1", "v5", "v3-t2"), duration: float = 6.4) -> Draws:
    posed = problem(swimming(fish, modes, noise=None, duration=duration))
    return Draws(posed, at(posed, posed.start(TRUTH)))
