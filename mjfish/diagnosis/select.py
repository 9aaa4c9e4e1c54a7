"""Which causes: the confidence set by test inversion, and the goodness of fit of its members.

A set l of causes stays as long as, were l the truth, the best rival would beat it by the observed margin more often
than in 5 % of cases; or as long as the likelihood of the best is less than ten times its own: if two causes
that can be told apart fit equally well, the data are odd under both, and neither is named. With whitened predictions
eta_k at the refits and d_k = eta_k - eta_l,

    LR_k - LR_l = 2 d_k' eps - |d_k|^2,    eps ~ N(0, 1),    were l true,

jointly over all rivals k ([Cox1961] for separate families, here with the fitted curves themselves, so that causes which
are not linear in their amplitudes, or not smooth, need no linearisation). Held-out trials take part with the likelihood
that they have, given the fitted ones (docs/notes/018): often they were swum otherwise, and rivals differ most there.

[Cox1961] D. R. Cox, Tests of separate families of hypotheses, Proc. 4th Berkeley Symposium.

**All runs.** What a model leaves in them, and whether a cause has the same size, and the water the same coefficients,
in each. The velocities of held-out runs take part. What belongs to such a run alone (start, clock, walk) is fitted to
it; then one step of all parameters from the fit, M, takes out what the run says of coefficients and sizes.

Where another cause is at work, which depends on how or when a run was swum, every run asks for sizes of its own. With
the derivative of the whitened prediction along the size psi of a cause, d = J psi, or along all coefficients of added
mass, of drag or of friction at once, and its cuts d_r to single runs,

    D = M (d_1 .. d_R),    z = M e

z' D (D'D)^+ D' z is chi-squared, with one degree of freedom less for each d than there are runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence, RunEffects, flipped_p, gather, tail, unscored, with_scores
from mjfish.diagnosis.failures import NOMINAL, finite, tried
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.refit import refit_nonsmooth
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.table import Comparison, Names, Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects.effect import Effect
from mjfish.estimation.fit import End, fit_at
from mjfish.estimation.residual import trial_parameters
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import block_angular


def of_all_runs(model: Refit | Evidence, held_out: tuple[Trial, ...]) -> Evidence:
    """Return what a fitted model leaves in its runs and in held-out ones, by one step; no candidate is scored."""
    others = [replace(trial, sensors=()) if trial.measured.any() else trial for trial in held_out]
    own = trial_parameters(model.problem, model.fit.values, others)  # a first sample is no place to linearise about
    every = replace(model.problem, trials=(*model.problem.trials, *others), windows=None)
    x = every.start({**own, **model.fit.values})
    resting = {p.name for p, at_bound in zip(model.fit.parameters, model.fit.at_bound, strict=True) if at_bound}
    at_bound = np.array([p.name in resting for p in every.parameters])
    return unscored(every, fit_at(every, End(x, x, at_bound, "converged", "", 0, np.nan)))


def sizes_by_run(refit: Refit, every: Evidence) -> RunEffects:
    """Return the derivatives along sizes of causes and along coefficients, cut to single runs, of `of_all_runs`."""
    problem, slopes = every.problem, every.fit.jacobian
    along, named = [], [(p, float(v)) for p, v in zip(problem.parameters, every.fit.x, strict=True)]
    for effect in refit.effects:
        null = {p.name: p.default for p in effect.amplitudes()}
        along.append(slopes @ np.array([v - null.get(p.name, v) for p, v in named]))
    coefficients = problem.model.fish.coefficient_names
    for kind in dict.fromkeys(name.partition(".")[0] for name in coefficients):
        own = {name for name in coefficients if name.startswith(f"{kind}.")}
        changed = [v * (p.name in own and not rests) for (p, v), rests in zip(named, every.fit.at_bound, strict=True)]
        along.append(slopes @ np.array(changed))
    columns = np.stack(along, axis=1)
    blocks = block_angular(columns[:, :0], problem.trial_rows, [columns[r] for r in problem.trial_rows])
    return RunEffects(every.jacobian, every.coefficients, blocks)


#: Random draws of a margin.
DRAWS = 4000
#: Below this share, what the tests of common waves and of sizes by run see does not count, nor what a cause without a
#: score explains: they see the slightest error of form.
_SLIGHT = 0.01
#: Rows of residuals that are compared at a time.
_ROWS = 2**16


def _rivalry(refits: Mapping[Names, Refit], held_out: HeldOut) -> dict[Names, Row]:
    """Return, per refit, the row with the margin by which the best rival beats it; what it leaves is not tested."""
    names, beyond = list(refits), held_out.of_rivals(refits)
    residuals = np.empty((len(names), refits[names[0]].fit.count + len(beyond[names[0]])))
    for row, name in zip(residuals, names, strict=True):
        row[:] = np.concatenate([refits[name].fit.residual, beyond[name]])
    gains = np.array([refits[name].adjusted - float(beyond[name] @ beyond[name]) for name in names])
    without = [gains + np.sum(residuals[:, rows] ** 2, axis=1) for rows in refits[names[0]].problem.trial_rows]
    chosen = np.mean([most == most.max() for most in without], axis=0).tolist() if len(without) > 1 else None
    result, rng = {}, np.random.default_rng(0)  # its own: what else is drawn moves no verdict
    for index, name in enumerate(names):
        inner = sum(_inner(residuals[:, at : at + _ROWS], index) for at in range(0, residuals.shape[1], _ROWS))
        values, root = np.linalg.eigh(inner)
        root *= np.sqrt(np.maximum(values, 0.0))
        margin = 2.0 * rng.standard_normal((DRAWS, len(names))) @ root.T - np.diag(inner)
        observed = float(gains.max() - gains[index])
        finite("the comparison of the candidates", margin=observed, by_run=float(margin.sum()))
        # its margin over itself is 0, which the root has rounded
        beaten = np.count_nonzero(margin.max(axis=1, initial=0.0) >= observed - 1e-9)
        result[name] = Row.of(
            name, refits[name], observed, (1 + int(beaten)) / (1 + DRAWS), chosen[index] if chosen else None
        )
    return result


def _inner(residuals: FloatArray, index: int) -> FloatArray:
    """Return the inner products of eta_k - eta_l over some rows, of all k and one l."""
    apart = residuals[index] - residuals
    return np.asarray(apart @ apart.T)


def excused(
    statistic: tuple[float, int], flipped: Callable[[], float], slight: float = -np.inf
) -> tuple[float, tuple[float, int]]:
    """Return the p value of a statistic, and it with its rank; 0 and 0 where outliers of the noise explain it.

    Args:
        statistic: with its rank.
        flipped: returns the p value over all flips of the signs; asked for only if needed.
        slight: what is less than this beyond chance does not count: the p value is 1.
    """
    p = 1.0 if statistic[0] - statistic[1] < slight else tail(*statistic)
    if p >= THRESHOLDS.goodness or (by_flips := flipped()) < p:
        return p, statistic
    return by_flips, ((0.0, 0) if by_flips >= THRESHOLDS.goodness else statistic)


def _unseen(refit: Refit, candidates: Sequence[Effect], explained: float) -> tuple[float, tuple[float, int]]:
    """Refit the causes that do nothing up to some size, for no score sees them; return what they explain.

    That is a p value and the fall of the sum of squares by the best with its degrees of freedom, one more for the
    choice of its size; 1 and nothing where it explains little beside the gain. They are refitted to the fitted runs,
    and taken to explain as much of what the refit explains of all.
    """
    after = gather(refit.problem, refit.fit, [e for e in candidates if e.starts_off_null() and not e.limits])
    p, found = refit_nonsmooth(after, after.candidates)
    best = max(found.values(), key=lambda refit: refit.gain, default=None)
    if best is None or best.gain < _SLIGHT * refit.gain:
        return 1.0, (0.0, 0)
    return p, (best.gain * explained / refit.gain, round(best.degrees_of_freedom) + 1)


class Goodness:
    """The goodness of fit of refits, each computed once.

    Args:
        candidates: causes whose joint score at a refit says whether it leaves anything.
        held_out: what refits predict of trials in which they should leave nothing, either.
    """

    def __init__(self, candidates: Sequence[Effect], held_out: HeldOut) -> None:
        self.candidates, self.held_out = tuple(candidates), held_out
        self.known: dict[Refit, dict[str, Any]] = {}

    def of(self, refit: Refit, row: Row) -> Row:
        """Return the row of a refit with the tests of what it leaves."""
        if refit not in self.known:
            self.known[refit] = tried(refit.names, lambda: self._tested(refit), dict[str, Any]())
        return replace(row, **self.known[refit])

    @cached_property
    def _nominal(self) -> float:
        """What the nominal model leaves in all runs; 0 where that fails."""

        def remainder() -> float:
            cleared = of_all_runs(self.held_out.evidence, self.held_out.trials).cleared
            return float(cleared @ cleared)

        return tried([NOMINAL], remainder, 0.0)

    def _tested(self, refit: Refit) -> dict[str, Any]:
        """Return the p values of the tests and what is left beyond chance, by field of `Row`.

        The cheapest test comes first. A set that fails one and leaves more than a third of the misfit is not tested
        further; one that leaves more than a tenth is not tested for causes without a score.

        Raises:
            FloatingPointError: one is no number.
        """
        every = of_all_runs(refit, self.held_out.trials)
        explained = max(self._nominal - float(every.cleared @ every.cleared), refit.gain)
        tests: dict[str, float] = {}
        most = 0.0, 0
        limits = (THRESHOLDS.resembles, THRESHOLDS.remaining, THRESHOLDS.remaining)
        for limit, stage in zip(limits, self._stages(refit, every, explained), strict=True):
            if np.isnan([(p, statistic) for p, (statistic, _) in stage.values()]).any():
                raise FloatingPointError("a test of what it leaves is no number")
            tests.update({name: p for name, (p, _) in stage.items()})
            most = max([most, *((statistic - rank, rank) for _, (statistic, rank) in stage.values())])
            share = most[0] / max(explained + most[0], 1e-9)
            if min(tests.values()) < THRESHOLDS.goodness and share >= limit:
                break
        return {"tests": tests, "excess": most[0], "rank": most[1], "beyond": explained - refit.gain}

    def _stages(
        self, refit: Refit, every: Evidence, explained: float
    ) -> Iterator[dict[str, tuple[float, tuple[float, int]]]]:
        """Yield the p value and the statistic with its rank, by test, in three stages."""
        left, by_run, slight = every.cleared, sizes_by_run(refit, every), _SLIGHT * explained
        yield {
            "waves": excused(every.omnibus, lambda: every.waves.flipped_p(left)),
            "common waves": excused(every.common(), lambda: flipped_p(every.common_waves, left), slight),
            "sizes by run": excused(by_run.statistic(left), lambda: by_run.flipped_p(left), slight),
        }
        after = with_scores(every, self.candidates)
        yield {"candidates": excused(after.saturated(), lambda: flipped_p(after.signatures, left))}
        yield {"unseen causes": _unseen(refit, self.candidates, explained)}


def compared(refits: Mapping[Names, Refit], goodness: Goodness) -> Comparison:
    """Return the rows of sets of one size; only of those in the confidence set it is tested what they leave."""
    refits = goodness.held_out.predicted(refits)
    found = _rivalry(refits, goodness.held_out) if refits else {}
    return Comparison({n: goodness.of(refits[n], row) if row.stays() else row for n, row in found.items()})
