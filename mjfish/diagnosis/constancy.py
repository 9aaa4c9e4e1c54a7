"""Whether a cause has the same size, and the water the same coefficients, in every run.

Where another cause is at work, which depends on how or when a run was swum, every run asks for sizes of its own. With
the derivative of the whitened prediction along the size psi of a cause, d = J psi, or along all coefficients of added
mass, of drag or of friction at once, its cuts d_r to single runs, and the projector M off all that is free in the fit,

    D = M (d_1 .. d_R),    z = M e

z' D (D'D)^+ D' z is chi-squared, with one degree of freedom less for each d than there are runs.

The velocities of held-out runs take part, linearised at the fit: what they say of coefficients and sizes is taken out
with M. A held-out run that no size of its own explains is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
        return self._by_run.statistic(self.cleared)

    def flipped_p(self) -> float:
        """Return the p value of the statistic over all flips of signs."""
        return self._by_run.flipped_p(self.cleared)

    @cached_property
    def _by_run(self) -> ByRun:
        along, named = [], [(p, float(v)) for p, v in zip(self.problem.parameters, self.x, strict=True)]
        for effect in self.refit.effects:
            null = {p.name: p.default for p in effect.amplitudes()}
            along.append(self.slopes @ np.array([v - null.get(p.name, v) for p, v in named]))
        coefficients = self.problem.model.fish.coefficient_names
        for kind in dict.fromkeys(name.partition(".")[0] for name in coefficients):
            own = {name for name in coefficients if name.startswith(f"{kind}.")}
            changed = [v * (p.name in own and free) for (p, v), free in zip(named, self.free, strict=True)]
            along.append(self.slopes @ np.array(changed))
        return self._cut(along)

    def _cut(self, along: Sequence[FloatArray]) -> ByRun:
        """Return columns (n,) cut to each run: to held-out ones only where the column alone explains what is left."""
        blocks = []
        for i, rows in enumerate(self.problem.trial_rows):
            kept = [own[rows, None] for own in along if self._predicted(i, rows, own)]
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

    def _predicted(self, i: int, rows: IntArray, alone: FloatArray) -> bool:
        """Return whether a run counts."""
        if i < len(self.refit.problem.trials):
            return True
        return bool(np.mean(project_out(orthonormal(alone[rows, None]), self.cleared[rows]) ** 2) < _PREDICTED)


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
