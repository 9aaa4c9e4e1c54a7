"""Whether a cause has the same size in every run.

A cause has one size. Where another one is at work, which depends on how a run was swum, every run asks for a size of
its own. With the size psi of a cause at its refit, the derivative of the whitened prediction along it, d = J psi, its
cuts d_r to single runs, and the projector M off all that is free in the fit,

    T = z' D (D' D)^+ D' z,    D = M (d_1 .. d_R),    z = M e

is chi-squared with one degree of freedom less than there are runs, of each cause. Held-out runs take part, linearised
at the fit: what they say of coefficients and sizes is taken out with M. A held-out run that no size explains is left
out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.arrays import orthonormal, project_out
from mjfish.data import Trial
from mjfish.diagnosis.refit import Refit

#: A held-out run that is left with a mean square above this, whatever the size of the cause in it, does not count.
_PREDICTED = 1.25
#: Share of a column's energy below which what is left of it is rounding.
_ROUNDING = 1e-6


def sizes_by_run(refit: Refit, held_out: tuple[Trial, ...] = ()) -> tuple[float, int]:
    """Return the statistic of the sizes by run, and its degrees of freedom; 0 where nothing is to be compared.

    Args:
        refit: of one cause or several.
        held_out: runs that were not fitted.
    """
    every = replace(refit.problem, trials=(*refit.problem.trials, *held_out), windows=None)
    names, x = [p.name for p in every.parameters], every.start(refit.fit.values)
    slopes, residual = every.jacobian(x), every.residual(x)
    resting = {p.name for p, at_bound in zip(refit.fit.parameters, refit.fit.at_bound, strict=True) if at_bound}
    span = orthonormal(slopes[:, [name not in resting for name in names]])
    cleared = project_out(span, residual[:, None])[:, 0]
    columns = []
    for effect in refit.effects:
        null = {p.name: p.default for p in effect.amplitudes()}
        along = slopes @ [value - null.get(name, value) for name, value in zip(names, x, strict=True)]
        for i, run in enumerate(every.rows_by_trial()):
            own = orthonormal(along[run, None])
            left = project_out(own, cleared[run, None])
            if i < len(refit.problem.trials) or np.mean(left**2) < _PREDICTED:
                columns.append(np.zeros(len(along)))
                columns[-1][run] = along[run]
    cuts = np.stack(columns, axis=1)
    beyond = project_out(span, cuts)
    seen = np.sum(beyond**2, axis=0) > _ROUNDING * np.sum(cuts**2, axis=0).max()
    basis = orthonormal(beyond[:, seen])
    return float(np.sum((basis.T @ cleared) ** 2)), basis.shape[1]
