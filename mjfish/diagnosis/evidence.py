"""Evidence against a fitted model: score tests of every candidate on its whitened residual.

With whitened residuals e, baseline sensitivities J and effect sensitivities S.

    z = M e,  S^ = M S,  M = I - J (J'J)^+ J',      u = S^' z,  I = S^' S^,      T = u' I^+ u

All statistics are computed after the baseline's sensitivities are projected out: a refit of the coefficients hides most
of an effect, and only what survives it can name one. Amplitudes that cannot be negative count only where they are not.

**Single runs.** Columns that they have are tested beyond what the free parameters explain, in time linear in runs. With
the derivative J of the whitened prediction by the free parameters, an orthonormal basis Q of its span, and columns
W_r of run r alone, W = diag(W_1 .. W_R): what J and W explain together, less what J does. Nothing as large as W' W is
kept.

**Flips.** How much of noise with outliers a basis explains by chance: its distribution over all flips of the signs.
What m orthonormal columns q explain of Gaussian noise is chi2(m). One outlier adds to it by far more. With independent,
symmetric noise every sign is as likely as the other, given all sizes |z| ([Hemerik2020]), and over all flips

    T = |q'z|^2,  A = q' diag(z^2) q:   mean = tr A,   variance = 2 (|A|^2 - sum_i |q_i|^4 z_i^4)

with rows q_i. A misfit has equal signs in a row: flipped, little of it is left. The tail is that of a multiple of a
chi2 with this mean and variance.

[Hemerik2020] J. Hemerik, J. Goeman and L. Finos, Robust testing in generalized linear models by sign flipping score
contributions, JRSS B 82.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, combinations
from typing import TypeVar

import numpy as np
from scipy import special, stats

from mjfish.diagnosis.failures import Failure, attempted, failed, note, noted
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Noise, Problem
from mjfish.estimation.fit import Linearised
from mjfish.estimation.omnibus import HATS, WAVES, by_channel, functions
from mjfish.estimation.problem import Slopes
from mjfish.execution import check_time, execution, limited
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import BoolArray, FloatArray, blocks_of, checked, principal_axes
from mjfish.numerics.block_angular import Basis, BlockAngular, block_angular, explained, span
from mjfish.numerics.sized_cache import Recomputable, always
from mjfish.parameters import Parameter


def flipped_p(columns: FloatArray, residual: FloatArray) -> float:
    """Return the p value of what columns (n, k) explain of a residual (n,), over all flips of its signs.

    Args:
        columns: what the fitted parameters leave of them; they may depend on each other.
        residual: whitened, of the fit.
    """
    axes = Basis((), columns @ principal_axes(columns.T @ columns))
    return tail_of_flips(axes, Basis((), np.zeros((len(columns), 0))), residual)


def tail_of_flips(both: Basis, first: Basis, residual: FloatArray) -> float:
    """Return the p value of z' (Q Q' - P P') z over all flips of the signs, Q = `both`, P = `first`."""
    squares, leverage = residual**2, both.leverage() - first.leverage()
    mean = float(np.sum(leverage * squares))
    spread = both.square(both, squares) - 2.0 * both.square(first, squares) + first.square(first, squares)
    variance = 2.0 * float(spread - np.sum((leverage * squares) ** 2))
    if not min(mean, variance) > 0.0:
        return 1.0
    explained = both.explained(residual) - first.explained(residual)
    return float(stats.chi2.sf(2.0 * explained * mean / variance, 2.0 * mean**2 / variance))


@dataclass(frozen=True, eq=False)
class RunEffects:
    """Columns of single runs beside the parameters of a fit.

    Attributes:
        jacobian: (n, p) J.
        basis: Q.
        columns: (n, k) W: no shared ones.
    """

    jacobian: BlockAngular
    basis: Basis
    columns: BlockAngular

    def statistic(self, cleared: FloatArray) -> tuple[float, int]:
        """Return what W explains of a residual (n,) that J explains nothing of, and the rank that W adds to J."""
        both, rank = explained(self.jacobian.beside(self.columns), cleared)
        return both, rank - self.basis.rank

    def flipped_p(self, cleared: FloatArray) -> float:
        """Return the p value of the statistic over all flips of signs."""
        return tail_of_flips(span(self.jacobian.beside(self.columns)), self.basis, cleared)

    def fitted(self, cleared: FloatArray) -> FloatArray:
        """Return what the columns explain (n,) of a residual."""
        return np.asarray(cleared - span(self.jacobian.beside(self.columns)).off(cleared))


T = TypeVar("T")


def one_sided_statistic(u: FloatArray, information: FloatArray, positive: BoolArray) -> FloatArray:
    """Return T = max over feasible amplitudes psi of 2 u'psi - psi' I psi, for many draws at once.

    The maximum is that of a set of amplitudes off zero whose unconstrained solution has allowed signs; few of them
    cannot be negative, so that all sets of these are tried, with all others.

    Args:
        u: (draws, d) scores.
        information: (d, d).
        positive: (d,) amplitudes that cannot be negative.
    """
    best = np.zeros(len(u))
    for index in _active_sets(positive):
        solution = u[:, index] @ np.linalg.pinv(information[np.ix_(index, index)], hermitian=True)
        feasible = np.all((solution >= 0.0) | ~positive[index], axis=1)
        best = np.maximum(best, np.where(feasible, np.einsum("ij,ij->i", solution, u[:, index]), 0.0))
    return best


def _active_sets(positive: BoolArray) -> Iterator[list[int]]:
    """Yield the sets of amplitudes that may be off zero: those of any sign, and some of the others."""
    signed, other = np.flatnonzero(~positive), np.flatnonzero(positive)
    for some in chain.from_iterable(combinations(other, k) for k in range(len(other) + 1)):
        if len(signed) + len(some):
            yield sorted([*map(int, signed), *map(int, some)])


def amplitudes(u: FloatArray, information: FloatArray, positive: BoolArray) -> FloatArray:
    """Return the feasible amplitudes psi (d,) that maximise 2 u'psi - psi' I psi."""
    best, found = 0.0, np.zeros(len(u))
    for index in _active_sets(positive):
        solution = np.linalg.pinv(information[np.ix_(index, index)], hermitian=True) @ u[index]
        if np.all((solution >= 0.0) | ~positive[index]) and (value := float(solution @ u[index])) > best:
            best, found = value, np.zeros(len(u))
            found[index] = solution
    return found


def p_value_of(statistic: float, degrees_of_freedom: float) -> float:
    """Return the p value of a likelihood-ratio statistic."""
    return float(stats.chi2.sf(max(statistic, 0.0), degrees_of_freedom))


def log_tail(statistic: FloatArray | float, degrees_of_freedom: int) -> FloatArray:
    """Return log P(chi2(freedom) > statistic): statistics of different size compare on it, however far out.

    Beyond 500, where the tail underflows, by its asymptotic series with a = freedom / 2, x = statistic / 2:
    x^(a - 1) exp(-x) / Gamma(a) (1 + (a - 1) / x + (a - 1)(a - 2) / x^2), [Abramowitz1964] 6.5.32.
    """
    t = np.asarray(statistic, dtype=np.float64)
    a, x = 0.5 * degrees_of_freedom, 0.5 * np.maximum(t, 500.0)
    far = (a - 1.0) * np.log(x) - x - special.gammaln(a) + np.log1p((a - 1.0) / x * (1.0 + (a - 2.0) / x))
    return np.where(t > 500.0, far, stats.chi2.logsf(np.minimum(t, 500.0), degrees_of_freedom))


#: Noncentrality that a family of some twenty causes at 5 % needs for 90 % power: (2.99 + 1.28)^2.
DETECTED = 18.0
#: Draws of the simulated null distributions.
DRAWS = 4000
#: Share of a signature's energy, after the projection, below which an effect is unidentifiable. Rounding and quadrature
#: leave 1e-8 of a structurally unidentifiable one; 1e-4 may show in velocities that are precise at low frequencies.
_UNIDENTIFIABLE = 1e-6
#: Energy of a signature, of amplitudes at their scale and in units of the noise, that is rounding.
_NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class Evidence:
    """A fit and the score tests of the effects that it lacks.

    Attributes:
        problem: that was fitted.
        fit: its result.
        candidates: effects that are not in the model, in a fixed order.
        amplitudes: their amplitude parameters, one tuple a candidate.
        cleared: (n,) z, the whitened residual less its part in the span of J.
        score: (d,) u = S^' z, all candidates' amplitudes stacked, amplitudes in units of their scale.
        information: (d, d) S^' S^.
        raws: returns `raw`: it may have to be made again.
        coefficients: orthonormal basis of the span of J.
    """

    problem: Problem
    fit: Fit
    candidates: tuple[Effect, ...]
    amplitudes: tuple[tuple[Parameter, ...], ...]
    cleared: FloatArray
    score: FloatArray
    information: FloatArray
    raws: Callable[[], FloatArray]
    coefficients: Basis

    @property
    def raw(self) -> FloatArray:
        """Signatures S~ (n, d) before the projection."""
        return self.raws()

    @property
    def signatures(self) -> FloatArray:
        """S^ (n, d), made anew: it is as large as `raw`."""
        return self.coefficients.off(self.raw)

    @cached_property
    def _every_coefficient(self) -> Basis:
        """Basis of the derivatives by all free parameters, those at a bound too."""
        return span(self.fit.jacobian)

    @property
    def blocks(self) -> dict[str, slice]:
        """Where each candidate's amplitudes stand in `score`."""
        slices = blocks_of([len(own) for own in self.amplitudes])
        return {effect.name: block for effect, block in zip(self.candidates, slices, strict=True)}

    def amplitudes_of(self, name: str) -> tuple[Parameter, ...]:
        """Return the amplitude parameters of one candidate."""
        return self.amplitudes[[effect.name for effect in self.candidates].index(name)]

    def positive(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which amplitudes of a candidate cannot be negative."""
        return np.array([p.default == p.low for p in self.amplitudes_of(name)])

    def statistic(self, name: str) -> float:
        """Return T of one candidate at the observed score."""
        return float(self._statistics(name, self.score[None, :])[0])

    def worth(self, name: str) -> float:
        """Return T of one candidate less two for every amplitude: what candidates of different size compare on."""
        return self.statistic(name) - 2.0 * self._degrees_of_freedom(name)

    def statistics(self, draws: FloatArray) -> dict[str, FloatArray]:
        """Return T of every candidate for many score vectors (draws, d)."""
        return {name: self._statistics(name, draws) for name in self.blocks}

    def _statistics(self, name: str, draws: FloatArray) -> FloatArray:
        block = self.blocks[name]
        return one_sided_statistic(draws[:, block], self.information[block, block], self.positive(name))

    def first_guess(self, name: str) -> dict[str, float]:
        """Return the one-step estimate of a candidate's amplitudes by name."""
        block = self.blocks[name]
        psi = amplitudes(self.score[block], self.information[block, block], self.positive(name))
        return {p.name: p.default + float(v) * p.scale for p, v in zip(self.amplitudes_of(name), psi, strict=True)}

    def confounded(self, name: str) -> float:
        """Return the confounded share: the part of a candidate's signature energy that a refit of the model absorbs."""
        block = self.blocks[name]
        energy = float(np.sum(self.raw[:, block] ** 2))
        return 1.0 - float(np.trace(self.information[block, block])) / max(energy, 1e-300)

    def unidentifiable(self, name: str) -> bool:
        """Return whether a candidate is structurally unidentifiable beside the coefficients.

        Coefficients at a bound count as free: such a candidate would show only because of the bound.
        """
        block = self.blocks[name]
        left = self._every_coefficient.off(self.raw[:, block])
        return float(np.sum(left**2)) < _UNIDENTIFIABLE * float(np.sum(self.raw[:, block] ** 2))

    def scored(self, name: str) -> bool:
        """Return whether a candidate's score says anything: it is identifiable, and its signature is not rounding.

        That of a cause which is not smooth at its null may be nothing there.
        """
        return float(np.sum(self.raw[:, self.blocks[name]] ** 2)) > _NOTHING and not self.unidentifiable(name)

    def refitted(self, name: str, amplitudes: Mapping[str, float]) -> dict[str, float]:
        """Return where the free parameters go, to first order, once a candidate has these amplitudes.

        x - (J'J)^+ J' S~ psi, cut at the bounds.
        """
        own, block = self.amplitudes_of(name), self.blocks[name]
        psi = np.array([(amplitudes[p.name] - p.default) / p.scale for p in own])
        free = np.flatnonzero(~self.fit.at_bound)
        move = self.jacobian.solve(self.raw[:, block] @ psi, 1e-8)
        values = self.fit.values
        for index, shift in zip(free, move, strict=True):
            p = self.fit.parameters[index]
            values[p.name] = float(np.clip(values[p.name] - shift, p.low, p.high))
        return values

    def minimum_detectable(self, name: str) -> dict[str, float]:
        """Return, per amplitude, the size that would have shown with 90 % power: sqrt(DETECTED / I)."""
        block = self.blocks[name]
        own = self.amplitudes_of(name)
        inverse = np.linalg.pinv(self.information[block, block], hermitian=True)
        return {
            p.name: float(np.sqrt(DETECTED * max(v, 0.0))) * p.scale for p, v in zip(own, np.diag(inverse), strict=True)
        }

    def directed_p(self) -> float:
        """Return the family-wise p value of the largest candidate (Westfall-Young), on the scale of chi2 tails.

        Candidates without a score are left out: their statistics are quotients of rounding errors. So are those that
        are not smooth at their null: no size of them does what the derivative there says. 1 without any other.
        """
        seen = [effect.name for effect in self.candidates if effect.smooth and self.scored(effect.name)]
        if not seen:
            return 1.0
        observed = min(float(log_tail(self.statistic(name), self._degrees_of_freedom(name))) for name in seen)
        values, vectors = np.linalg.eigh(self.information)
        root = vectors * np.sqrt(np.maximum(checked(values), 0.0))
        draws = (
            np.random.default_rng(0).standard_normal((DRAWS, len(values))) @ root.T
        )  # scores of noise alone, N(0, I)
        simulated = self.statistics(draws)
        smallest = np.min([log_tail(simulated[name], self._degrees_of_freedom(name)) for name in seen], axis=0)
        p = float(np.mean(smallest <= observed))
        # Beyond the reach of the draws, Bonferroni bounds it.
        return p if p > 0.0 else min(len(seen) * float(np.exp(observed)), 1.0 / DRAWS)

    def saturated(self) -> tuple[float, int]:
        """Return the statistic of all candidates jointly and its rank; compares the model with model + everything."""
        return _quadratic(self.score, self.information)

    @cached_property
    def omnibus(self) -> tuple[float, int]:
        """Statistic of the omnibus basis, which knows no cause, and its rank."""
        return self.waves.statistic(self.cleared)

    @cached_property
    def common_waves(self) -> FloatArray:
        """The omnibus waves (n, k) that are the same in all runs, from start to end, beside the free parameters.

        They are few, and see what is small in each run, yet there in every one.
        """
        waves = self.waves.columns
        summed = np.zeros((len(self.cleared), max(part.block.shape[1] for part in waves.parts) // HATS))
        for part in waves.parts:
            own = part.block.reshape(len(part.rows), -1, HATS, WAVES).sum(axis=2).reshape(len(part.rows), -1)
            summed[part.rows, : own.shape[1]] = own
        return self.coefficients.off(summed)

    def common(self) -> tuple[float, int]:
        """Return statistic and rank of the common waves."""
        return _quadratic(self.common_waves.T @ self.cleared, self.common_waves.T @ self.common_waves)

    def saturated_excess(self) -> float:
        """Return what all candidates jointly explain beyond chance: their statistic less its rank."""
        statistic, rank = self.saturated()
        return statistic - rank

    @cached_property
    def jacobian(self) -> BlockAngular:
        """The derivatives J by the free parameters that are not at a bound."""
        return self.fit.jacobian.chosen(~self.fit.at_bound)

    @property
    def waves(self) -> RunEffects:
        """The omnibus basis beside the free parameters, made anew: it has as many columns a run as there are waves."""
        return RunEffects(self.jacobian, self.coefficients, whitened_omnibus(self.problem))

    def _degrees_of_freedom(self, name: str) -> int:
        block = self.blocks[name]
        return int(block.stop - block.start)


def gather(
    problem: Problem, fit: Fit, candidates: Sequence[Effect], known_signatures: Callable[[], Slopes] | None = None
) -> Evidence:
    """Compute residual, projected signatures and omnibus scores at a fit.

    Args:
        problem: that was fitted.
        fit: its result; parameters at a bound are treated as fixed.
        candidates: effects to score; those already in the model are left out.
        known_signatures: returns their `signatures`, where they are known already.
    """
    return with_scores(unscored(problem, fit), candidates, known_signatures)


def unscored(problem: Problem, fit: Fit) -> Evidence:
    """Return the evidence at a fit without candidates; the omnibus basis needs none."""
    if problem.smoother is not problem:
        fit = replace(fit, linearised=Recomputable(partial(_linearised, problem, fit)))
    coefficients = span(fit.jacobian.chosen(~fit.at_bound))
    return Evidence(
        problem=problem,
        fit=fit,
        candidates=(),
        amplitudes=(),
        cleared=coefficients.off(fit.residual),
        score=np.zeros(0),
        information=np.zeros((0, 0)),
        raws=always(np.zeros((fit.count, 0))),
        coefficients=coefficients,
    )


def with_scores(
    evidence: Evidence, candidates: Sequence[Effect], known_signatures: Callable[[], Slopes] | None = None
) -> Evidence:
    """Add the scores of candidates to an evidence without any; arguments as of `gather`."""
    problem, fit, coefficients = evidence.problem, evidence.fit, evidence.coefficients
    held = {effect.name for effect in problem.model.effects}
    kept = tuple(effect for effect in candidates if effect.name not in held)
    known = None if known_signatures is None else problem.rows(known_signatures()).shared
    raw = signature_rows(problem, fit.values, _unfailing(kept)) if known is None else known
    raws = Recomputable(partial(signature_rows, problem, fit.values, _unfailing(kept)), raw)
    inside, score, information = coefficients.coordinates(raw), np.zeros(raw.shape[1]), np.zeros((raw.shape[1],) * 2)
    for rows in (*problem.trial_rows, *np.arange(problem.measured, len(raw))[:, None]):
        left = coefficients.off_at(rows, raw, inside)
        score += left.T @ evidence.cleared[rows]
        information += left.T @ left
    amplitudes = tuple(effect.amplitudes() for effect in kept)
    return replace(evidence, candidates=kept, amplitudes=amplitudes, score=score, information=information, raws=raws)


def _linearised(problem: Problem, fit: Fit) -> Linearised:
    """Return what a fit is linearised to along the best guess of the joint angles, see `Problem.smoother`."""
    return replace(fit.linearised(), jacobian=problem.smoother.jacobian(fit.x))


def under(evidence: Evidence, noises: Sequence[Noise], known_signatures: Callable[[], Slopes]) -> Iterator[Evidence]:
    """Yield what the evidence would be under other noises, refitted to first order.

    Args:
        evidence: at a fit.
        noises: the others.
        known_signatures: `signatures` of its candidates.
    """
    problem, x = evidence.problem, evidence.fit.x
    raw, slopes = problem.raw_and_sensors(x), problem.slopes(x)
    for noise in noises:
        other = replace(problem, noise=noise)
        residual, jacobian = other.rows(raw).shared[:, 0], other.jacobian_of(slopes, x)
        residual[other.measured :] = other.deviation_rows(x)[0]
        linearised = replace(evidence.fit.linearised(), jacobian=jacobian)
        seen = replace(evidence.fit, residuals=always(residual), linearised=always(linearised))
        yield gather(other, seen, evidence.candidates, known_signatures)


def signatures(problem: Problem, values: Mapping[str, float], candidates: Sequence[Effect]) -> Slopes:
    """Return the derivatives of the prediction by every candidate's amplitudes, times scale.

    Args:
        problem: of the model without the candidates.
        values: of its parameters.
        candidates: causes at their null values.

    At coefficients that let the motion run away no derivative is finite; those that are not are 0, and say nothing. A
    candidate whose derivatives are not finite at the declared coefficients either fails, and so does one that raises.
    """

    def slopes(
        wide: Problem, x: FloatArray, names: Sequence[str], scales: FloatArray
    ) -> tuple[Slopes, Mapping[str, str]]:
        found = wide.slopes(x, only=names)
        for block in (*found.velocity, *found.sensors):
            block *= scales
        return found, found.lost

    found, lost = _derived(slopes, problem, values, _unfailing(candidates))
    if lost and not problem.divergence(problem.start(values)):
        again, names = _derived(slopes, problem, {}, [effect for effect in candidates if effect.name in lost])
        for name in names:
            place = next(place for full, place in again.lost.items() if full.partition(".")[0] == name)
            reason = f"the derivative by its sizes is not finite: {place}; see what it makes of the run there"
            note(Failure(name, reason))
    return found


def signature_rows(
    problem: Problem,
    values: Mapping[str, float],
    candidates: Sequence[Effect],
    shapes: Mapping[str, float] | None = None,
) -> FloatArray:
    """Return the same as whitened rows (n, d) of the residual, at shapes that may be others than the defaults.

    Rows of a candidate that failed, or whose derivative is not finite here, are zero: its score then says nothing.
    """
    rows, lost = _derived(Problem.rows_by, problem, values, candidates, shapes)
    rows[:, np.array([effect.name in lost for effect in candidates for _ in effect.amplitudes()], dtype=bool)] = 0.0
    return rows


def _derived(
    derive: Callable[[Problem, FloatArray, Sequence[str], FloatArray], tuple[T, Mapping[str, str]]],
    problem: Problem,
    values: Mapping[str, float],
    candidates: Sequence[Effect],
    shapes: Mapping[str, float] | None = None,
) -> tuple[T, list[str]]:
    """Return what `derive` finds by the candidates' amplitudes at their null, each in units of its scale.

    Where it raises, the candidates that raise alone are noted, and their columns are zero.

    Args:
        derive: takes the problem with the candidates, x, names and scales; returns also the names of `Slopes.lost`.
        problem, values, candidates, shapes: as of `signature_rows`.

    Returns:
        That, and the names of candidates of which a derivative is not finite.
    """
    together = partial(_derived_together, derive, problem, values)
    try:
        return together(candidates, shapes)
    except Exception:
        alone = [
            attempted([effect.name], partial(together, [effect], None))
            for effect in (candidates if noted() and shapes is None else ())  # else whoever asks says what failed
        ]
        failures = [one for one in alone if isinstance(one, Failure)]
        if not failures or len(failures) == len(alone) > 1:
            raise  # it is the fault of none of them
        for failure in failures:
            note(failure)
        return _derived(derive, problem, values, _unfailing(candidates))


def _unfailing(effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects; in place of each that failed is one with the same parameters that does nothing."""
    return [_idle(effect) if failed([effect.name]) else effect for effect in effects]


def _idle(effect: Effect) -> Effect:
    own = {name: getattr(effect, name) for name in ("name", "domain", "parameters")}
    return type("Idle", (Effect,), own)()  # type: ignore[no-any-return]


def _derived_together(
    derive: Callable[[Problem, FloatArray, Sequence[str], FloatArray], tuple[T, Mapping[str, str]]],
    problem: Problem,
    values: Mapping[str, float],
    candidates: Sequence[Effect],
    shapes: Mapping[str, float] | None,
) -> tuple[T, list[str]]:
    """Return what `_derived` returns where no candidate raises."""
    wide = replace(problem, model=replace(problem.model, effects=(*problem.model.effects, *candidates))).smoother
    null = {p.name: p.default for effect in candidates for p in effect.parameters}
    x = wide.start({**null, **(shapes or {}), **values})
    amplitudes = [p for effect in candidates for p in effect.amplitudes()]
    with limited(execution().limit * max(len(candidates), 1)):
        found, lost = derive(wide, x, [p.name for p in amplitudes], np.array([p.scale for p in amplitudes]))
        check_time()
    return found, [effect.name for effect in candidates if any(p.name in lost for p in effect.amplitudes())]


def whitened_omnibus(problem: Problem) -> BlockAngular:
    """Return the omnibus basis (n, columns) in the problem's whitened space; every column touches one trial only.

    A trial has columns of its velocities, where any was measured, then of every channel of its sensors.
    """
    cpg, blocks = problem.model.fish.cpg, []
    for index, trial in enumerate(problem.trials):
        sizes = [len(CHANNELS) * bool(trial.measured.any()), *(len(sensor.channels) for sensor in trial.sensors)]
        count, white = sum(sizes), []
        if sizes[0]:
            waves = functions(cpg, trial, trial.time)[problem.mask(index)]
            white.append(problem.whitened(index, by_channel(waves, range(len(CHANNELS)), count)))
        pairs = zip(trial.sensors, blocks_of(sizes)[1:], strict=True)
        read = [by_channel(functions(cpg, trial, s.time), range(at.start, at.stop), count) for s, at in pairs]
        white += problem.white_sensors(index, read)
        blocks.append(np.concatenate([own.reshape(-1, own.shape[2]) for own in white]))
    return block_angular(np.zeros((problem.measured + len(problem.with_priors), 0)), problem.trial_rows, blocks)


def tail(statistic: float, rank: int) -> float:
    """Return the p value of a statistic; 1 where nothing was left to test."""
    return float(stats.chi2.sf(statistic, rank)) if rank else 1.0


def _quadratic(u: FloatArray, information: FloatArray) -> tuple[float, int]:
    """Return u' I^+ u and the rank of I."""
    axes = principal_axes(information)
    return float(np.sum((axes.T @ u) ** 2)), axes.shape[1]
