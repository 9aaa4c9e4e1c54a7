"""How much coefficients differ from run to run, beyond the error with which each run tells them.

The coefficients of run r are theta + b_r, with b_r ~ N(0, diag(tau^2)). To first order its whitened residual at the
common fit, in the coordinates of `mjfish.estimation.by_trial`, is then

    y_r = R_r (delta + b_r) + e_r,    var(y_r) = V_r = Omega_r + R_r diag(tau^2) R_r'

with delta what the common fit is off by, and tau is that of the largest restricted likelihood ([Patterson1971]):

    -2 log L = sum_r log |V_r| + log |X' V^-1 X| + y' P y,   P = V^-1 - V^-1 X (X' V^-1 X)^-1 X' V^-1

where X has all columns that the fit has. For one coefficient that every run tells with the same error this is the
between-study variance of [DerSimonian1986]. All coefficients are estimated together: one that is scattered does not
lend its scatter to those that are correlated with it, and a run that says nothing of a coefficient says nothing of its
scatter. Where there is none, the estimate is 0 in most cases (three of four, over 240 draws of white and of AR(1) noise
of 0.8 in six runs), and else about the error of a run.

[Patterson1971] H. D. Patterson, R. Thompson: Recovery of inter-block information when block sizes are unequal.
[DerSimonian1986] R. DerSimonian, N. Laird: Meta-analysis in clinical trials, Controlled Clinical Trials 7.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from mjfish.arrays import FloatArray, checked
from mjfish.estimation.by_trial import Reduced, reduced, span
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem

#: Share of the mean variance of a residual that every one has at least, so that recordings without noise have some.
_LEAST = 1e-9
#: Scatter below this share of the error of a single run is none.
_NONE = 1e-3


def scatter(problem: Problem, fit: Fit, small: Reduced | None = None) -> dict[str, float]:
    """Return the standard deviation tau from run to run of every coefficient that may differ, by name.

    Those that rest on a bound, that belong to a trial, or that have a prior (a value of a learned curve, of which a
    run alone says nothing) do not differ and are left out; nothing differs in a single run, or is told where not every
    run has all velocities.

    Args:
        problem: that was fitted.
        fit: of it, converged.
        small: its residual and Jacobian by trial, where they are known already.
    """
    prior = {name for own in problem.priors for name in own.parameters}
    free = [p for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True) if not at_bound and ":" not in p.name]
    places = [i for i, p in enumerate(free) if p.name not in prior]
    if len(problem.trials) < 2 or not places or not problem.complete:
        return {}
    small = small or reduced(problem, fit)
    own = [free[i] for i in places]
    tau = _deviations(small, places, np.array([p.high - p.low for p in own]))
    return {p.name: float(v) for p, v in zip(own, tau, strict=True)}


def _deviations(small: Reduced, places: Sequence[int], widest: FloatArray) -> FloatArray:
    """Return tau (k,) of the parameters at these columns; none is above its `widest` (k,), the width of its bounds."""
    runs, rows, _ = small.factors.shape
    random = small.factors[:, :, places]
    fixed = span(small.common).reshape(runs, rows, -1)
    least = max(_LEAST * float(np.einsum("rii->r", small.omega).mean()) / rows, 1e-300)
    omega = small.omega + least * np.eye(rows)
    told = np.einsum("rki,rki->i", random, np.linalg.solve(omega, random)) / runs
    unit = 1.0 / np.maximum(told, 1.0 / widest**2)  # squared error of a typical run
    y = small.residual[:, :, None]

    def objective(share: FloatArray) -> tuple[float, FloatArray]:
        """Return -2 log L and its gradient by tau^2 in these units."""
        root = np.linalg.cholesky(omega + (random * (share * unit)) @ np.swapaxes(random, 1, 2))
        x, z, e = (np.linalg.solve(root, part) for part in (fixed, random, y))
        gram = np.einsum("rki,rkj->ij", x, x)
        cross = np.swapaxes(x, 1, 2) @ z
        left = e - x @ np.linalg.solve(gram, np.einsum("rki,rko->io", x, e))
        value = 2.0 * np.sum(np.log(np.einsum("rii->ri", root))) + np.linalg.slogdet(gram)[1] + np.sum(left**2)
        trace = np.sum(z**2, axis=(0, 1)) - np.einsum("rmi,rmi->i", cross, np.linalg.solve(gram, cross))
        return float(checked(np.asarray(value))), (
            trace - np.sum(np.einsum("rki,rko->ri", z, left) ** 2, axis=0)
        ) * unit

    found = optimize.minimize(
        objective,
        np.ones(len(places)),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0, w**2 / u) for w, u in zip(widest, unit, strict=True)],
    )
    checked(found.x)
    share = np.where(found.x > _NONE**2, found.x, 0.0)
    return np.asarray(np.sqrt(share * unit))
