"""Whether a cause has the same size, and the water the same coefficients, in every run.

Where another cause is at work, which depends on how or when a run was swum, every run asks for sizes of its own. With
the derivative of the whitened prediction along the size psi of a cause, d = J psi, or along all coefficients of added
mass, of drag or of friction at once, its cuts d_r to single runs, and the projector M off all that is free in the fit,

    D = M (d_1 .. d_R),    z = M e

z' D (D'D)^+ D' z is chi-squared, with one degree of freedom less for each d than there are runs.

The velocities of held-out runs take part, linearised at the fit: what they say of coefficients and sizes is taken out
with M. A held-out run that no values of its own explain is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjfish.arrays import FloatArray, orthonormal, project_out
from mjfish.block_angular import Basis, BlockAngular, block_angular, span
from mjfish.data import Trial
from mjfish.diagnosis.by_run import ByRun
from mjfish.diagnosis.refit_result import Refit
from mjfish.estimation import Problem
from mjfish.estimation.residual import own_parameters

#: A held-out run that is left with a mean square above this, whatever its own numbers are, does not count.
_PREDICTED = 1.25


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
        columns = np.stack(along, axis=1)
        blocks = block_angular(columns[:, :0], self.problem.trial_rows, [columns[r] for r in self.problem.trial_rows])
        return ByRun(self.slopes.chosen(np.array(self.free)), self.span, blocks)


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
    residual, fitted = every.residual(x), len(refit.problem.trials)
    unexplained = [project_out(orthonormal(slopes.of_rows(r)), residual[r]) for r in every.trial_rows[fitted:]]
    predicted = tuple(t for t, left in zip(held_out, unexplained, strict=True) if np.mean(left**2) <= _PREDICTED)
    if len(predicted) < len(held_out):
        return linearised(refit, predicted)
    basis = span(slopes.chosen(np.array(free)))
    return Linearised(refit, every, x, slopes, free, basis, basis.off(residual))
