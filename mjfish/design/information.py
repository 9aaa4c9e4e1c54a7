"""What data, and a run more, say of parameters, of minimum detectable effects, and of two rival causes.

**Separation.** Were rival k the truth, at its own fit, the best that rival l could do after a refit of everything it
has leaves

    lambda_{k|l} = min over x_l of |eta_k - eta_l(x_l)|^2,   eta whitened predictions of all runs,

the noncentrality of the likelihood ratio of the two. By one Gauss-Newton step from the fit of l, with d = eta_k - eta_l
and J_l the derivative of eta_l by all that a refit moves,

    lambda_{k|l} = d'd - d'J_l (J_l'J_l)^+ J_l'd

All of it is sums over runs: a run more adds its J_l'J_l, J_l'd and d'd. To first order in the effect it is
psi_k' D_{k|l} psi_k of the score tests ([Eriksson2013]: distinguishability).

**Gain of a run.** The margin of the data, m = SSE_l - SSE_k, is known. With the run, were k true,

    m' - m = (d + u)' P_l (d + u) - u' P_k u,    d = eta_k - eta_l on the run,  u ~ N(0, T_k),
    P = (1 + J C J')^-1,    T_k = 1 + J_k C_k J_k',    C = (J_0'J_0)^-1 of the data,

where u is the noise and the error of the estimates of k ([Buzzi-Ferraris1984]: P_l weighs what a refit of l cannot
follow). What is the run's own, its start, is free in both P and drops out of u. Therefore

    E   = d'P_l d + tr((P_l - P_k) T_k)
    Var = 4 d'P_l T_k P_l d + 2 tr(((P_l - P_k) T_k)^2)

d is made of estimates: noise that the two fits do not share passes for a difference, of which d'P_l d is too large by

    tr(P_l Cov(d)),    Cov(d) = J_k C_k J_k' + J_l C_l J_l' - J_k C_kl J_l' - J_l C_lk J_k',    C_kl = C_k J_0k'J_0l C_l

on average, and that is taken off (down to nothing; of the variance, in the same proportion).

**Probability of a verdict.** A verdict drops l once its likelihood is a tenth of that of k
(`mjfish.diagnosis.thresholds.Thresholds.close`); that noise would lead so far in less than 5 % of cases, were l the
truth, is then so too: 2 z sqrt(lambda) - lambda, z = 1.645, is 2.7 at most. With a gain of mean g and standard
deviation s,

    P_k = Phi((m + g - 2 ln 10) / s)

and the odds that k is the true one are exp(m / 2). Of data not yet taken, of parameters that are known and of large
lambda (m = 0, g = lambda, s = 2 sqrt(lambda)) that tends to Phi(sqrt(lambda) / 2), which is
Phi(sqrt(lambda_k (1 - rho) / 2)) of nearly parallel signatures, lambda = lambda_k (1 - rho^2).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import special, stats

from mjfish.design.fitted_models import ModelEstimate
from mjfish.design.menu import Run
from mjfish.diagnosis.evidence import DETECTED
from mjfish.diagnosis.isolability import Isolability, isolated
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import Effect
from mjfish.estimation import Problem
from mjfish.numerics.arrays import FloatArray, solve
from mjfish.numerics.block_angular import BlockAngular
from mjfish.parameters import Parameter

#: A signature of which a refit leaves less than this share is structurally unidentifiable: what is left is rounding.
_CONFOUNDED = 1e-5


@dataclass(frozen=True, eq=False)
class Information:
    """Sums over runs of the columns of a Jacobian J and of a difference d, all whitened.

    Attributes:
        names: of the columns of J; columns of the same name in two runs are the same parameter.
        gram: J'J (p, p).
        moment: J'd (p,).
        square: d'd.
    """

    names: tuple[str, ...]
    gram: FloatArray
    moment: FloatArray
    square: float

    @classmethod
    def of(cls, names: tuple[str, ...], jacobian: FloatArray, difference: FloatArray | None = None) -> Information:
        """Return the sums of J (n, p) and d (n,); d is zero where there is no difference to explain."""
        d = np.zeros(len(jacobian)) if difference is None else difference
        return cls(names, jacobian.T @ jacobian, jacobian.T @ d, float(d @ d))

    @classmethod
    def joined(cls, runs: Sequence[Information]) -> Information:
        """Return the sums over all these runs."""
        names = tuple(dict.fromkeys(name for run in runs for name in run.names))
        places = {name: i for i, name in enumerate(names)}
        gram, moment = np.zeros((len(names), len(names))), np.zeros(len(names))
        for run in runs:
            at = [places[name] for name in run.names]
            gram[np.ix_(at, at)] += run.gram
            moment[at] += run.moment
        return cls(names, gram, moment, sum(run.square for run in runs))

    def of_rival(self, rival: str) -> Information:
        """Return the sums of the columns that `column` named after a rival."""
        at = [i for i, name in enumerate(self.names) if name.startswith(column(rival, ""))]
        return Information(tuple(self.names[i] for i in at), self.gram[np.ix_(at, at)], self.moment[at], self.square)

    @property
    def unexplained(self) -> float:
        """What a refit leaves of the difference: d'd - d'J (J'J)^+ J'd."""
        return max(self.square - float(self.moment @ solve(self.gram, self.moment[:, None])[:, 0]), 0.0)


def column(rival: str, parameter: str) -> str:
    """Return the name of a rival's own column; two rivals have parameters of the same name."""
    return f"{rival}/{parameter}"


def on_menu(problem: Problem, runs: Sequence[Run]) -> Problem:
    """Return the problem with the runs of a menu for its trials, all of their samples counted."""
    return replace(problem, trials=tuple(run.trial for run in runs), windows=None)


#: Names of columns (k,), and these (n, k).
Named = tuple[tuple[str, ...], FloatArray]


def jacobians(problem: Problem, x: FloatArray, names: Collection[str]) -> tuple[list[Named], list[Named]]:
    """Return whitened derivatives by parameters in units of their scales; a trial has no columns of another one.

    Returns:
        Of the velocities of every trial; of every sensor, and of what is known of the parameters themselves.
    """
    chosen = [p for p in problem.parameters if p.name in names]
    slopes = problem.slopes(x, names)
    columns = [[chosen[k] for k in (*slopes.shared, *own)] for own in slopes.per_trial]
    scales = [np.array([p.scale for p in own]) for own in columns]
    own_names = [tuple(p.name for p in own) for own in columns]
    velocities = [
        (own_names[i], problem.whitened(i, block * scales[i]).reshape(-1, len(scales[i])))
        for i, block in enumerate(slopes.velocity)
    ]
    sensors = [(own_names[i], rows * scales[i]) for (i, _), rows in zip(problem.sensors, slopes.sensors, strict=True)]
    known = [problem.parameters[i] for i in problem.with_priors if problem.parameters[i].name in names]
    rates = problem.deviation_rates(x)
    return velocities, [*sensors, *[((p.name,), np.array([[rates[p.name] * p.scale]])) for p in known]]


@dataclass(frozen=True, eq=False)
class _OnMenu:
    """Information of the data, and of every run of a menu; None of a run in which a model diverges."""

    data: Information
    runs: tuple[Information | None, ...]

    def with_run(self, run: int | None) -> Information:
        """Return the information of the data, with that of a run more."""
        added = None if run is None else self.runs[run]
        return self.data if added is None else Information.joined([self.data, added])


@dataclass(frozen=True, eq=False)
class Detection(_OnMenu):
    """Information on the nominal model's parameters and the causes' amplitudes: of the data, and of every run.

    Attributes:
        amplitudes: of every cause.
    """

    amplitudes: dict[str, tuple[Parameter, ...]]

    def sizes(self, cause: str, run: int | None = None) -> dict[str, float]:
        """Return the minimum detectable effect of each amplitude: sqrt(18 (I^-1)_jj), I = S'S - S'J (J'J)^+ J'S.

        Infinite where a refit of the coefficients hides all of it.
        """
        left, energy = self._remaining_information(self.amplitudes[cause], run)
        shown = np.diag(left) > _CONFOUNDED * np.maximum(energy, 1e-300)
        inverse = np.diag(np.linalg.pinv(left, hermitian=True))
        found = np.where(shown, np.sqrt(DETECTED * np.maximum(inverse, 0.0)), np.inf)
        return {p.name: float(size) * p.scale for p, size in zip(self.amplitudes[cause], found, strict=True)}

    def isolability(self, causes: Sequence[Effect], run: int | None = None, along: Collection[str] = ()) -> Isolability:
        """Return the isolability of the mechanisms of the causes; `along` these amplitudes, or the typical ones."""
        left, energy = self._remaining_information([p for cause in causes for p in self.amplitudes[cause.name]], run)
        return isolated(left, energy, causes, along)

    def _remaining_information(self, amplitudes: Sequence[Parameter], run: int | None) -> tuple[FloatArray, FloatArray]:
        """Return S'S - S'J (J'J)^+ J'S (d, d) of some amplitudes, and the diagonal (d,) of S'S."""
        sums = self.with_run(run)
        own = [sums.names.index(p.name) for p in amplitudes]
        others = {p.name for every in self.amplitudes.values() for p in every}
        theta = [i for i, name in enumerate(sums.names) if name not in others]
        mixed, own_block = sums.gram[np.ix_(theta, own)], sums.gram[np.ix_(own, own)]
        return own_block - mixed.T @ solve(sums.gram[np.ix_(theta, theta)], mixed), np.diag(own_block)


def detection(nominal: ModelEstimate, causes: Sequence[Effect], runs: Sequence[Run]) -> Detection:
    """Derive the nominal model by its parameters and by every cause at its null, on the data and on the menu."""
    problem = nominal.problem
    wide = replace(problem, model=replace(problem.model, effects=(*problem.model.effects, *causes)))
    menu = on_menu(wide, runs)
    parameters = [p for cause in causes for p in cause.parameters]
    here = {p.name: p.default for p in parameters} | problem.named(nominal.x)
    fixed = nominal.at_bound | {p.name for p in parameters if p.shape}
    finite = [bool(np.all(np.isfinite(prediction))) for prediction in menu.predictions(menu.start(here))]
    added, _ = _information(menu, here, fixed)
    trials, beside = _information(wide, here, fixed)
    return Detection(
        amplitudes={cause.name: cause.amplitudes() for cause in causes},
        data=Information.joined([*trials, *beside]),
        runs=tuple(run if ok else None for run, ok in zip(added, finite, strict=True)),
    )


def _information(
    problem: Problem, here: dict[str, float], fixed: frozenset[str]
) -> tuple[list[Information], list[Information]]:
    """Return the information of every trial's velocities, and that of what stands behind them."""
    free = [p.name for p in problem.parameters if p.name not in fixed]
    velocities, beside = jacobians(problem, problem.start(here), free)
    return [Information.of(*block) for block in velocities], [Information.of(*block) for block in beside]


class Gain(NamedTuple):
    """What a run adds to the margin of the true one of two rivals: its mean and standard deviation."""

    mean: float
    spread: float


NO_GAIN = Gain(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Separation(_OnMenu):
    """Two rivals on the data and on every run of a menu.

    `data` and `runs` have J = [J_k, J_l] and d = eta_k - eta_l, columns named by `mjfish.design.information.column`.

    Attributes:
        rivals: their names (k, l).
        margin: SSE_l - SSE_k on the data.
    """

    rivals: tuple[str, str]
    margin: float

    def noncentrality(self, run: int | None = None) -> float:
        """Return the smaller one of lambda_{k|l} and lambda_{l|k}, of the data and of the data with a run more."""
        return min(self.noncentrality_of(rival, run) for rival in self.rivals)

    def noncentrality_of(self, truth: str, run: int | None = None) -> float:
        """Return lambda where one of the rivals is the truth."""
        return self.with_run(run).of_rival(self._other(truth)).unexplained

    def gain(self, truth: str, run: int | None) -> Gain:
        """Return what a run is expected to add to the margin where one of the rivals is the truth."""
        added = None if run is None else self.runs[run]
        return NO_GAIN if added is None else gain(self.data, added, truth, self._other(truth))

    def probability(self, run: int | None = None) -> float:
        """Return the probability of the right verdict, with the data as they are or with a run more."""
        first, second = self.rivals
        is_first = float(special.expit(0.5 * self.margin))
        return is_first * self.probability_of(first, run) + (1.0 - is_first) * self.probability_of(second, run)

    def probability_of(self, truth: str, run: int | None = None) -> float:
        """Return the probability of the right verdict where one of the rivals is the truth."""
        return verdict_probability(self.margin if truth == self.rivals[0] else -self.margin, self.gain(truth, run))

    def _other(self, rival: str) -> str:
        return self.rivals[1] if rival == self.rivals[0] else self.rivals[0]


def excluded(margin: float) -> bool:
    """Return whether a verdict drops the rival l at the margin SSE_l - SSE_k."""
    return margin >= THRESHOLDS.close


def verdict_probability(margin: float, gain: Gain) -> float:
    """Return the probability P_k that the rival l is dropped where k is true.

    Args:
        margin: SSE_l - SSE_k of the data.
        gain: of a run, where k is true; `NO_GAIN` without one.
    """
    return float(stats.norm.cdf((margin + gain.mean - THRESHOLDS.close) / max(gain.spread, 1e-6)))


def gain(data: Information, run: Information, k: str, l: str) -> Gain:  # noqa: E741 - the equation's
    """Return what a run adds to SSE_l - SSE_k where k is true.

    Args:
        data, run: J = [J_k, J_l] and d of the pair.
        k, l: names of the rivals.
    """
    columns, d = _coordinates(run)
    identity = np.eye(len(d))
    both = Information.joined([data, run])
    p_k, p_l = (identity - _followed(both, columns, rival) for rival in (k, l))
    error_k, error_l = (_error(data.of_rival(rival), columns) for rival in (k, l))
    t_k = identity + _covariance(error_k, data)
    raw = float(d @ p_l @ d)
    by_noise = _covariance({**error_k, **{name: -e for name, e in error_l.items()}}, data)
    seen = max(raw - float(np.trace(p_l @ by_noise)), 0.0)
    turned = (p_l - p_k) @ t_k
    variance = 4.0 * (seen / max(raw, 1e-300)) * float(d @ p_l @ t_k @ p_l @ d) + 2.0 * float(np.trace(turned @ turned))
    return Gain(seen + float(np.trace(turned)), float(np.sqrt(max(variance, 0.0))))


def _coordinates(run: Information) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the columns of J by name, and d, in an orthonormal basis (q,) of what they span."""
    joint = np.block([[run.gram, run.moment[:, None]], [run.moment[None, :], np.array([[run.square]])]])
    values, vectors = np.linalg.eigh(joint)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return dict(zip(run.names, root.T[:-1], strict=True)), root[:, -1]


def _on_the_run(names: tuple[str, ...], columns: dict[str, FloatArray]) -> FloatArray:
    """Return J (q, p) of the run; what is an old run's own moves nothing there."""
    still = np.zeros(len(next(iter(columns.values()))))
    return np.stack([columns.get(name, still) for name in names], axis=1)


def _followed(total: Information, columns: dict[str, FloatArray], rival: str) -> FloatArray:
    """Return 1 - P (q, q) of a rival: what a refit to all runs follows."""
    own = total.of_rival(rival)
    j = _on_the_run(own.names, columns)
    return np.asarray(j @ solve(own.gram, j.T))


def _error(own: Information, columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return J C (q,) by column of the data: how noise along it moves the prediction of the run."""
    return dict(zip(own.names, solve(own.gram, _on_the_run(own.names, columns).T), strict=True))


def _covariance(errors: Mapping[str, FloatArray], data: Information) -> FloatArray:
    """Return the covariance (q, q) of the predictions that the noise of the data moves."""
    at = [data.names.index(name) for name in errors]
    moved = np.stack(list(errors.values()), axis=1)
    return np.asarray(moved @ data.gram[np.ix_(at, at)] @ moved.T)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """A model, linearised at its estimates for all trials.

    Attributes:
        names: of the columns of the Jacobian.
        residual: (n,) whitened, of the data and of what is known of the parameters.
        jacobian: (n, p) of the whitened prediction of the same.
        runs: by run of the menu, the whitened prediction (m,), and its Jacobian (m, q) with names.
    """

    names: tuple[str, ...]
    residual: FloatArray
    jacobian: BlockAngular
    runs: tuple[tuple[FloatArray, tuple[str, ...], FloatArray], ...]


def separations(rivals: Sequence[ModelEstimate], runs: Sequence[Run]) -> tuple[Separation, ...]:
    """Compare every pair of rivals at their estimates, on the data and on every run."""
    return tuple(
        Separation(
            rivals=(k.name, l.name),
            margin=float(of_l.residual @ of_l.residual - of_k.residual @ of_k.residual),
            data=_difference(of_k, of_l),
            runs=tuple(
                Information.of((*names_k, *names_l), np.hstack([j_k, j_l]), eta_k - eta_l)
                if np.all(np.isfinite(eta_k - eta_l))
                else None
                for (eta_k, names_k, j_k), (eta_l, names_l, j_l) in zip(of_k.runs, of_l.runs, strict=True)
            ),
        )
        for (k, of_k), (l, of_l) in combinations([(rival, _linearised(rival, runs)) for rival in rivals], 2)  # noqa: E741
    )


def _linearised(model_estimate: ModelEstimate, runs: Sequence[Run]) -> _Linearised:
    """Linearise a model at its estimates for all trials.

    Estimates that were fitted to some of the trials only, as those of a diagnosis, are moved for the others by one
    Gauss-Newton step, to first order: the sum of squares of the fitted ones is stationary there.
    """
    problem = model_estimate.problem
    off = np.array([p.name not in model_estimate.at_bound for p in problem.parameters])
    free = [p for p, kept in zip(problem.parameters, off, strict=True) if kept]
    jacobian = problem.jacobian(model_estimate.x).chosen(off).scaled(columns=np.array([p.scale for p in free]))
    residual = problem.residual(model_estimate.x)
    new = np.zeros_like(residual)
    for rows in problem.trial_rows[model_estimate.fitted :]:
        new[rows] = residual[rows]
    step = solve(jacobian.gram(), jacobian.transposed_times(new)[:, None])[:, 0]
    moved = {p.name: float(by) for p, by in zip(free, step, strict=True)}
    menu = on_menu(problem, runs)
    x = menu.start(problem.named(model_estimate.x))
    relevant = [p.name for p in menu.parameters if p.name in moved or ":" in p.name]
    predictions, (velocities, _) = menu.predictions(x), jacobians(menu, x, relevant)
    parts = []
    for i, (eta, (own, slopes)) in enumerate(zip(predictions, velocities, strict=True)):
        seen = eta[menu.mask(i)]
        white = menu.whitened(i, seen).ravel() if np.all(np.isfinite(seen)) else np.full(len(slopes), np.nan)
        shift = np.array([moved.get(name, 0.0) for name in own])
        parts.append((white + slopes @ shift, tuple(column(model_estimate.name, name) for name in own), slopes))
    names = tuple(column(model_estimate.name, p.name) for p in free)
    return _Linearised(names, residual - jacobian @ step, jacobian, tuple(parts))


def _difference(k: _Linearised, l: _Linearised) -> Information:  # noqa: E741
    """Return the information on the difference of two models on the data."""
    both, d = k.jacobian.beside(l.jacobian), l.residual - k.residual
    return Information((*k.names, *l.names), both.gram(), both.transposed_times(d), float(d @ d))
