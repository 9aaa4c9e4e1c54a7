"""What a refit leaves in all runs, and whether a cause has the same size, and the water the same coefficients, in each.

The velocities of held-out runs take part, linearised at the fit: what they say of coefficients and sizes is taken out
with the projector M off all that is free. A held-out run that no values of its own explain is left out.

Where another cause is at work, which depends on how or when a run was swum, every run asks for sizes of its own. With
the derivative of the whitened prediction along the size psi of a cause, d = J psi, or along all coefficients of added
mass, of drag or of friction at once, and its cuts d_r to single runs,

    D = M (d_1 .. d_R),    z = M e

z' D (D'D)^+ D' z is chi-squared, with one degree of freedom less for each d than there are runs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.arrays import orthonormal, project_out
from mjfish.block_angular import block_angular
from mjfish.data import Trial
from mjfish.diagnosis.by_run import ByRun
from mjfish.diagnosis.evidence import Evidence, unscored
from mjfish.diagnosis.refit_result import Refit
from mjfish.estimation.fit import End, fit_at
from mjfish.estimation.residual import own_parameters

#: A held-out run that is left with a mean square above this, whatever its own numbers are, does not count.
_PREDICTED = 1.25


def of_all_runs(refit: Refit, held_out: tuple[Trial, ...] = ()) -> Evidence:
    """Return what a refit leaves in its runs and in held-out ones, linearised at the refit; no candidate is scored."""
    others = [replace(trial, sensors=()) if trial.measured.any() else trial for trial in held_out]
    filmed = [trial for trial in others if not trial.measured.any()]  # a first sample is no place to linearise about
    starts = own_parameters(refit.problem, refit.fit.values, filmed)
    every = replace(refit.problem, trials=(*refit.problem.trials, *others), windows=None)
    x = every.start({**starts, **refit.fit.values})
    resting = {p.name for p, at_bound in zip(refit.fit.parameters, refit.fit.at_bound, strict=True) if at_bound}
    at_bound = np.array([p.name in resting for p in every.parameters])
    here = unscored(every, fit_at(every, End(x, x, at_bound, "converged", "", 0, np.nan)))
    slopes, residual, fitted = here.fit.jacobian, here.fit.residual, len(refit.problem.trials)
    unexplained = [project_out(orthonormal(slopes.of_rows(r)), residual[r]) for r in every.trial_rows[fitted:]]
    predicted = tuple(t for t, left in zip(held_out, unexplained, strict=True) if np.mean(left**2) <= _PREDICTED)
    return here if len(predicted) == len(held_out) else of_all_runs(refit, predicted)


def sizes_by_run(refit: Refit, every: Evidence) -> ByRun:
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
    return ByRun(every.jacobian, every.coefficients, blocks)
