"""The same swimming under many draws of noise: each is fitted from the truth, what all draws share is made once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from changed_fit import having
from scipy import signal
from synthetic_swimming import TRUTH, problem, swimming

from mjfish.drive.modes import MODES
from mjfish.estimation import Fit, Problem, fit
from mjfish.estimation.fit import covariance
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import BlockAngular

#: Skin friction in the middle of its bounds, four standard errors of coloured noise from either.
INSIDE = {**TRUTH, "c_f.head": 0.0105, "c_f.body": 0.0105, "c_f.tail": 0.0105}
#: Gauss-Newton steps of a fit from the truth; the last is below a thousandth of a standard error.
_STEPS = 3


@dataclass(frozen=True, eq=False)
class Draws:
    """What all draws share.

    Attributes:
        problem: without noise in the data; its noise gives the weights.
        base: a fit at the truth.
        slopes: (n, p, p) derivative of the Jacobian by the parameters.
    """

    problem: Problem
    base: Fit
    slopes: FloatArray

    @property
    def truth(self) -> FloatArray:
        """True coefficients (p,)."""
        return self.problem.start(INSIDE)

    def fits(self, phi: float, count: int, seed: int) -> Iterator[Fit]:
        """Fit `count` draws of AR(1) noise of the stated size, white where phi is 0."""
        rng = np.random.default_rng(seed)
        for _ in range(count):
            yield self.fit(self.noise(phi, rng))

    def noise(self, phi: float, rng: np.random.Generator) -> FloatArray:
        """Draw noise of unit variance, stacked as residuals are; masked samples are a gap in it."""
        parts = []
        for i, trial in enumerate(self.problem.trials):
            white = rng.standard_normal((len(trial.time) + 100, 3))
            coloured = signal.lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0)[100:]
            parts.append(coloured[self.problem.mask(i)].ravel())
        return np.concatenate(parts)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the Jacobian (n, p) near the truth."""
        return np.asarray(self.base.jacobian.dense() + self.slopes @ (x - self.base.x))

    def fit(self, noise: FloatArray) -> Fit:
        """Fit one draw: Gauss-Newton from the truth with exact rollouts, the Jacobian right to second order."""
        x = self.base.x
        for _ in range(_STEPS):
            x = x + np.linalg.lstsq(self.jacobian(x), self.problem.residual(x) + noise)[0]
        residual = self.problem.residual(x) + noise
        jacobian = self.jacobian(x)
        spread = covariance(BlockAngular.of(jacobian), self.base.at_bound)
        return having(
            self.base,
            x=x,
            sse=float(residual @ residual),
            residual=residual,
            jacobian=BlockAngular.of(jacobian),
            covariance=spread,
            reach=np.sqrt(np.diag(spread)),
        )


def draws(fish: Fish, modes: tuple[str, ...] = MODES, duration: float = 10.4) -> Draws:
    """Simulate `INSIDE` and make what all draws share."""
    posed = problem(swimming(fish, modes, values=INSIDE, noise=None, duration=duration))
    base = fit(posed, posed.start(INSIDE))
    sigma = np.sqrt(np.diag(base.covariance))
    slopes = [
        (posed.jacobian(base.x + h * unit).dense() - base.jacobian.dense()) / h
        for h, unit in zip(sigma, np.eye(len(sigma)), strict=True)
    ]
    return Draws(posed, base, np.stack(slopes, axis=2))
