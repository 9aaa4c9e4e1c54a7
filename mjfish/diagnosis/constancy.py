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

from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray, orthonormal, project_out
from mjfish.block_angular import Basis, BlockAngular, span
from mjfish.data import Trial
from mjfish.diagnosis.refit import Refit
from mjfish.estimation import Problem

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
        cuts = []
        for effect in self.refit.effects:
            null = {p.name: p.default for p in effect.amplitudes()}
            sizes = [v - null.get(p.name, v) for p, v in zip(self.problem.parameters, self.x, strict=True)]
            along = self.slopes @ np.array(sizes)
            cuts.append(self._cut(along[:, None], along[:, None]))
        columns = np.concatenate(cuts, axis=1)
        beyond = self.span.off(columns)
        seen = np.sum(beyond**2, axis=0) > _ROUNDING * np.sum(columns**2, axis=0).max()
        basis = orthonormal(beyond[:, seen])
        return float(np.sum((basis.T @ self.cleared) ** 2)), basis.shape[1]

    def coefficients(self) -> FloatArray:
        """Return D (n, columns) of the coefficients that are not at a bound, each times its value."""
        names = set(self.problem.model.fish.coefficient_names)
        own = [p.name in names and free for p, free in zip(self.problem.parameters, self.free, strict=True)]
        return self.span.off(self._cut(self.slopes.dense()[:, own] * self.x[own], self.slopes.dense()))

    def _cut(self, columns: FloatArray, explaining: FloatArray) -> FloatArray:
        """Return the columns (n, k) cut to each run: held-out ones only if `explaining` (n, m) explains them alone."""
        found = []
        for i in range(len(self.problem.trials)):
            run = self.problem.rows_of({i})
            left = project_out(orthonormal(explaining[run]), self.cleared[run, None])
            if i < len(self.refit.problem.trials) or np.mean(left**2) < _PREDICTED:
                found.append(np.zeros_like(columns))
                found[-1][run] = columns[run]
        return np.concatenate(found, axis=1)


def linearised(refit: Refit, held_out: tuple[Trial, ...] = ()) -> Linearised:
    """Return a refit linearised over its runs and held-out ones."""
    others = (replace(trial, sensors=()) for trial in held_out)
    every = replace(refit.problem, trials=(*refit.problem.trials, *others), windows=None)
    x = every.start(refit.fit.values)
    slopes = every.jacobian(x)
    resting = {p.name for p, at_bound in zip(refit.fit.parameters, refit.fit.at_bound, strict=True) if at_bound}
    free = [p.name not in resting for p in every.parameters]
    basis = span(slopes.chosen(np.array(free)))
    return Linearised(refit, every, x, slopes, free, basis, basis.off(every.residual(x)))
