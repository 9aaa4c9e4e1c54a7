"""Whether a cause has the same size, and the fish the same coefficients, in every run.

A cause has one size, and a coefficient one value. Where another cause is at work, which depends on how or when a run
was swum, every run asks for values of its own. With the derivative of the whitened prediction along a number, d, its
cuts d_r to single runs, and the projector M off all that is free in the fit,

    D = M (d_1 .. d_R),    z = M e

tell. Of the size psi of each cause, d = J psi, and z' D (D'D)^+ D' z is chi-squared with one degree of freedom less
than there are runs. The coefficients are many, and some hardly seen: theirs is the test of relative changes that are
drawn alike (`mjfish.diagnosis.weighted_sum`).

The velocities of held-out runs take part, linearised at the fit: what they say of coefficients and sizes is taken out
with M. A held-out run that no values of its own explain is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray, orthonormal, project_out
from mjfish.block_angular import Basis, BlockAngular, IntArray, block_angular, span
from mjfish.data import Trial
from mjfish.diagnosis.by_run import ByRun
from mjfish.diagnosis.refit_result import Refit
from mjfish.estimation import Problem
from mjfish.estimation.residual import own_parameters

#: A held-out run that is left with a mean square above this, whatever its own numbers are, does not count.
_PREDICTED = 1.25
#: Share of a column's energy below which what is left of it is rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Linearised:
    """A refit linearised over all runs, held-out ones too.

    Attributes:
        refit: of one cause or several.
        problem: of all runs.
        x: (k,) its free parameters at the refit.
        slopes: (n, k) derivative of the whitened prediction.
        free: (k,) whether they are not at a bound of the refit.
        span: orthonormal basis of the slopes of the free ones.
        cleared: (n,) z.
    """

    refit: Refit
    problem: Problem
    x: FloatArray
    slopes: BlockAngular
    free: list[bool]
    span: Basis
    cleared: FloatArray

    def sizes(self) -> tuple[float, int]:
        """Return the statistic of the sizes by run, and its degrees of freedom; 0 where nothing is to be compared."""
        along = []
        for effect in self.refit.effects:
            null = {p.name: p.default for p in effect.amplitudes()}
            sizes = [v - null.get(p.name, v) for p, v in zip(self.problem.parameters, self.x, strict=True)]
            along.append(self.slopes @ np.array(sizes))
        return self._cut([column[:, None] for column in along], along).statistic(self.cleared)

    def coefficients(self) -> ByRun:
        """Return the derivatives by run of the coefficients that are not at a bound, each times its value."""
        names = set(self.problem.model.fish.coefficient_names)
        own = [p.name in names and free for p, free in zip(self.problem.parameters, self.free, strict=True)]
        return self._cut([self.slopes.of_columns(np.flatnonzero(own).tolist()) * self.x[own]], [None])

    def _cut(self, columns: Sequence[FloatArray], explaining: Sequence[FloatArray | None]) -> ByRun:
        """Return the columns (n, k) cut to each run: held-out ones only if what explains them, (n,), does so alone.

        None: all that is free in the run.
        """
        blocks = []
        for i, rows in enumerate(self.problem.trial_rows):
            kept = [
                own[rows] for own, alone in zip(columns, explaining, strict=True) if self._predicted(i, rows, alone)
            ]
            blocks.append(np.concatenate([np.zeros((len(rows), 0)), *kept], axis=1))
        nothing = np.zeros((len(self.cleared), 0))
        by_run = ByRun(self.slopes.chosen(np.array(self.free)), self.span, BlockAngular.of(nothing))
        energy = [np.sum(block**2, axis=0) for block in blocks]
        beyond = replace(by_run, columns=block_angular(nothing, self.problem.trial_rows, blocks)).energy
        least = _ROUNDING * max((float(own.max(initial=0.0)) for own in energy), default=0.0)
        found = iter(beyond)
        seen = [next(found) > least if block.shape[1] else np.zeros(0, dtype=np.bool_) for block in blocks]
        solid = [block[:, own] for block, own in zip(blocks, seen, strict=True)]
        return replace(by_run, columns=block_angular(nothing, self.problem.trial_rows, solid))

    def _predicted(self, i: int, rows: IntArray, alone: FloatArray | None) -> bool:
        """Return whether a run counts."""
        if i < len(self.refit.problem.trials):
            return True
        explaining = self.slopes.of_rows(rows) if alone is None else alone[rows, None]
        return bool(np.mean(project_out(orthonormal(explaining), self.cleared[rows]) ** 2) < _PREDICTED)


def linearised(refit: Refit, held_out: tuple[Trial, ...] = ()) -> Linearised:
    """Return a refit linearised over its runs and held-out ones."""
    others = [replace(trial, sensors=()) if trial.measured.any() else trial for trial in held_out]
    filmed = [trial for trial in others if not trial.measured.any()]  # a first sample is no place to linearise about
    starts = own_parameters(refit.problem, refit.fit.values, filmed)
    every = replace(refit.problem, trials=(*refit.problem.trials, *others), windows=None)
    x = every.start({**starts, **refit.fit.values})
    slopes = every.smoother.jacobian(x)
    resting = {p.name for p, at_bound in zip(refit.fit.parameters, refit.fit.at_bound, strict=True) if at_bound}
    free = [p.name not in resting for p in every.parameters]
    basis = span(slopes.chosen(np.array(free)))
    return Linearised(refit, every, x, slopes, free, basis, basis.off(every.residual(x)))
