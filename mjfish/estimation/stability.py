"""One set of coefficients for all trials against one for each: is the model's answer the same from run to run?

Linearised about the common fit, a residual e moves by J d. Let coefficients differ between trials: of the columns that
this adds, K is what the common fit leaves, K = (1 - J J^+) diag_r(J_r). The sum of squares falls by

    Q = e' P e,   P the projection on K,   and is distributed as sum_k lambda_k chi2_1,   lambda of P Omega P

where the model holds, with Omega the residuals' own covariance in time (`mjfish.estimation.serial_correlation`). The
statistic is F = Q / sum lambda, with degrees of freedom (sum lambda)^2 / sum lambda^2 ([Satterthwaite1946], [Rao1981])
over those that the estimate of sum lambda has. White noise gives the F test of [Chow1960].

Of AR(1) noise of 0.8 on a stable fish, 5.7 % of 300 draws are below 0.05 in four trials of 10.4 s, 6.5 % of 400 in four
of 6 s, 8 % of 400 in three of 4 s.

Both this and the scatter are asked of residual and Jacobian in few numbers, trial by trial (`Reduced`).

**Scatter.** How much coefficients differ from run to run, beyond the error with which each run tells them. The
coefficients of run r are theta + b_r, with b_r ~ N(0, diag(tau^2)). To first order its whitened residual at the
common fit, in the coordinates of `Reduced`, is then

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
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, stats

from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import Serial, blocks_of, satterthwaite, serial_apart
from mjfish.numerics.arrays import FloatArray, checked, orthonormal, project_out

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
    fixed = orthonormal(small.common, RANK).reshape(runs, rows, -1)
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


#: Directions weaker than this share of the strongest are not counted.
RANK = 1e-6


@dataclass(frozen=True, eq=False)
class Reduced:
    """Everything in coordinates of J_r = Q_r R_r, trial by trial: few numbers for many samples.

    J_r has the columns of the parameters that trials share, less what those of the trial alone explain.

    Attributes:
        trials: names.
        serial: covariance of the residuals in time.
        bases: Q_r (n_r, 3, k) of every trial.
        factors: (trials, k, p) R_r.
        residual: (trials, k) Q_r' e_r.
        omega: (trials, k, k) Q_r' Omega_r Q_r.
    """

    trials: tuple[str, ...]
    serial: Serial
    bases: tuple[FloatArray, ...]
    factors: FloatArray
    residual: FloatArray
    omega: FloatArray

    @property
    def common(self) -> FloatArray:
        """Columns (trials k, p) of parameters that all trials share."""
        return self.factors.reshape(-1, self.factors.shape[2])


def reduced(problem: Problem, fit: Fit) -> Reduced:
    """Reduce to the span of each trial's columns; the noise is what is left when each trial is fitted alone.

    What the common fit leaves of trials that differ is no noise, and would hide that they do. Parameters at a bound
    have no columns.
    """
    jacobian = fit.jacobian.chosen(~fit.at_bound).top(problem.samples)
    blocks = blocks_of(problem, fit.residual)
    bases, factors, residual, left = [], [], [], []
    for block in blocks:
        alone, columns = jacobian.at(block.rows)
        e, (q_own, _) = fit.residual[block.rows], np.linalg.qr(alone)
        columns = project_out(q_own, columns)
        full = np.concatenate([columns, np.zeros((max(columns.shape[1] - len(columns), 0), columns.shape[1]))])
        q, r = np.linalg.qr(full)
        q = q[: len(columns)]
        bases.append(block.on_grid(q))
        factors.append(r)
        residual.append(q.T @ e)
        rest = project_out(q, project_out(q_own, e))
        both = block.on_grid(np.hstack([q_own, q]))
        left.append((replace(block, residual=block.on_grid(rest[:, None])[:, :, 0]), both))
    found = serial_apart([block for block, _ in left], [both for _, both in left])
    middles = [found.quadratic_of(r, q) for r, q in enumerate(bases)]
    return Reduced(
        tuple(block.trial for block in blocks),
        found,
        tuple(bases),
        np.array(factors),
        np.array(residual),
        np.array(middles),
    )


@dataclass(frozen=True)
class Moved:
    """One coefficient that may differ between trials while all others are common.

    Attributes:
        name: of the coefficient.
        statistic: F.
        degrees_of_freedom: its degrees of freedom.
        p_value: of the statistic where it does not differ.
        estimates: by trial; trials that do not move it have none.
        errors: their standard errors, in which those of the others are counted in.
    """

    name: str
    statistic: float
    degrees_of_freedom: tuple[float, float]
    p_value: float
    estimates: dict[str, float]
    errors: dict[str, float]


@dataclass(frozen=True)
class Stability:
    """Whether one set of coefficients serves all trials.

    Attributes:
        statistic: F of one set a trial against one for all.
        degrees_of_freedom: its degrees of freedom.
        p_value: of the statistic where one set serves all.
        coefficients: each alone, the one that most surely differs first.
        p_value_of_first: of the coefficient that differs most, corrected for how many there are (Bonferroni).
        p_value_combined: of both tests: twice the smaller of the two p values.
        stable: whether it is not below `alpha`; None where there is nothing to compare.
        alpha: probability of calling a stable model unstable.
        text: the same in words.
        scatter: standard deviation of each coefficient from trial to trial, beyond the error of its estimates by trial
            (`scatter`); empty where there is nothing to compare.
    """

    statistic: float
    degrees_of_freedom: tuple[float, float]
    p_value: float
    coefficients: tuple[Moved, ...]
    p_value_of_first: float
    p_value_combined: float
    stable: bool | None
    alpha: float
    text: str
    scatter: dict[str, float] = field(default_factory=dict)


def stability(problem: Problem, fit: Fit, *, alpha: float = 0.05) -> Stability:
    """Compare one set of coefficients for all trials with one for each.

    Coefficients at a bound stay there in every trial; start velocities and clocks of trials are their own in both.

    Args:
        problem: that was fitted.
        fit: of it, converged.
        alpha: probability of calling a stable model unstable.
    """
    shared = [k for k, p in enumerate(fit.parameters) if ":" not in p.name and not fit.at_bound[k]]
    if len(problem.trials) < 2 or not shared or not problem.complete:
        nothing = "one trial" if len(problem.trials) < 2 else "no free coefficient"
        nothing = nothing if problem.complete else "not every trial has surge, sway and yaw rate"
        return Stability(0.0, (0.0, 0.0), 1.0, (), 1.0, 1.0, None, alpha, f"{nothing}: there is nothing to compare")
    small = reduced(problem, fit)
    alone = [_moved(fit.parameters[k].name, float(fit.x[k]), small, place) for place, k in enumerate(shared)]
    statistic, degrees_of_freedom, p_value = _f_test(small, small.factors)
    ranked = tuple(sorted(alone, key=lambda test: (test.p_value, -test.statistic)))
    p_value_of_first = min(1.0, len(ranked) * ranked[0].p_value)
    p_value_combined = min(1.0, 2.0 * min(p_value, p_value_of_first))
    stable = p_value_combined >= alpha
    return Stability(
        statistic,
        degrees_of_freedom,
        p_value,
        ranked,
        p_value_of_first,
        p_value_combined,
        stable,
        alpha,
        _words(stable, p_value_combined, ranked[0], len(problem.trials)),
        scatter(problem, fit, small),
    )


def _f_test(small: Reduced, columns: FloatArray) -> tuple[float, tuple[float, float], float]:
    """Return F, its degrees of freedom and its p value, of columns that differ between trials beside the common ones.

    With bases C of the common columns, U_r of those of each trial, and D of what all U leave of C,

        P = U U' + D D' - C C',

    of which no more is made than blocks of single trials: C and D are few columns.

    Args:
        small: residual and common columns.
        columns: (trials, k, m) of every trial.
    """
    length = np.linalg.norm(columns, axis=1, keepdims=True)
    u, singular, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0), full_matrices=False)
    u = u * (singular > RANK)[:, None, :]
    c = _common(small.common, small)
    left, sizes, _ = np.linalg.svd(np.concatenate(_beside(u, c)), full_matrices=False)
    d = left[:, sizes > RANK].reshape(*c.shape[:2], np.count_nonzero(sizes > RANK))
    if np.count_nonzero(singular > RANK) + d.shape[2] == c.shape[2]:
        return 0.0, (0.0, 0.0), 1.0
    few = np.concatenate([d, c], axis=2)
    sign = np.repeat([1.0, -1.0], [d.shape[2], c.shape[2]])
    own, mixed, rest = (np.swapaxes(a, 1, 2) @ small.omega @ b for a, b in ((u, u), (u, few), (few, few)))
    both = rest.sum(axis=0)
    total = max(float(np.einsum("rii->", own) + np.diag(both) @ sign), 1e-300)
    square = np.sum(own**2) + 2.0 * np.sum(mixed**2 @ sign) + sign @ both**2 @ sign
    first = float(total**2 / max(float(square), 1e-300))
    values, vectors = np.linalg.eigh(u @ np.swapaxes(u, 1, 2) + (few * sign) @ np.swapaxes(few, 1, 2))
    roots = vectors * np.sqrt(np.maximum(checked(values), 0.0))[:, None, :]
    parts = enumerate(zip(small.bases, roots, strict=True))
    moments = np.sum([small.serial.moments(r, q @ root, total=True) for r, (q, root) in parts], axis=0)
    second = max(float(satterthwaite(*moments)[0]), 1.0)
    inside = np.einsum("rki,rk->i", few, small.residual)
    explained = np.sum(np.einsum("rki,rk->ri", u, small.residual) ** 2) + inside**2 @ sign
    statistic = max(float(explained), 0.0) / total
    return statistic, (first, second), float(stats.f.sf(statistic, first, second))


def _common(columns: FloatArray, small: Reduced) -> FloatArray:
    """Return an orthonormal basis (trials, k, c) of columns (trials k, m)."""
    basis = orthonormal(columns, RANK)
    return basis.reshape(*small.residual.shape, basis.shape[1])


def _beside(own: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns (trials, k, c) less their part in the bases (trials, k, m) of every trial."""
    for _ in range(2):  # once leaves rounding of what it takes out
        columns = columns - own @ (np.swapaxes(own, 1, 2) @ columns)
    return columns


def _moved(name: str, value: float, small: Reduced, place: int) -> Moved:
    """Return the test of one coefficient, and its estimates by trial, all others common: one Gauss-Newton step.

    Minimised is |y - diag_r(d_r) x - O b|, O the columns of the others: b of what all d_r leave, then x_r run by run.
    """
    columns = small.factors[:, :, place, None]
    statistic, degrees_of_freedom, p_value = _f_test(small, columns)
    length = np.linalg.norm(columns[:, :, 0], axis=1)
    moving, size = length > 0.0, np.where(length > 0.0, length, 1.0)
    u = columns / size[:, None, None]
    others = _common(np.delete(small.common, place, axis=1), small)
    left, singular, right = np.linalg.svd(np.concatenate(_beside(u, others)), full_matrices=False)
    solid = singular > RANK
    steps = (left[:, solid] @ (right[solid] / singular[solid, None])).reshape(others.shape)  # of b, transposed
    along = np.einsum("rki,rko->ro", u, others) / size[:, None]
    alone = np.einsum("rki,rk->r", u, small.residual) / size
    estimates = value + alone - along @ np.einsum("rko,rk->o", steps, small.residual)
    weighed = small.omega @ u
    variance = np.einsum("rki,rki->r", u, weighed) / size**2
    variance -= 2.0 * np.einsum("ro,rko,rki->r", along, steps, weighed) / size
    variance += np.einsum("ro,op,rp->r", along, np.einsum("rko,rkl,rlp->op", steps, small.omega, steps), along)
    errors = np.sqrt(np.maximum(variance, 0.0))
    names = [trial for trial, moves in zip(small.trials, moving, strict=True) if moves]
    return Moved(
        name=name,
        statistic=statistic,
        degrees_of_freedom=degrees_of_freedom,
        p_value=p_value,
        estimates=dict(zip(names, estimates[moving].tolist(), strict=True)),
        errors=dict(zip(names, errors[moving].tolist(), strict=True)),
    )


def _words(stable: bool, p_value: float, most: Moved, trials: int) -> str:
    if stable:
        return f"one set of coefficients serves all {trials} trials (p = {p_value:.2g})"
    ordered = sorted(most.estimates, key=most.estimates.__getitem__)
    ends = [f"{most.estimates[name]:.3g} +- {most.errors[name]:.2g} in {name}" for name in (ordered[0], ordered[-1])]
    return (
        f"coefficients differ between trials (p = {p_value:.2g}); most surely {most.name}: {ends[0]}, {ends[1]} "
        "(standard errors)"
    )
