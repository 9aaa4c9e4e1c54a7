"""What a model leaves in all runs, and whether a cause has the same size, and the water the same coefficients, in each.

The velocities of held-out runs take part. What belongs to such a run alone (start, clock, walk) is fitted to it; then
one step of all parameters from the fit, M, takes out what the run says of coefficients and sizes.

Where another cause is at work, which depends on how or when a run was swum, every run asks for sizes of its own. With
the derivative of the whitened prediction along the size psi of a cause, d = J psi, or along all coefficients of added
mass, of drag or of friction at once, and its cuts d_r to single runs,

    D = M (d_1 .. d_R),    z = M e

z' D (D'D)^+ D' z is chi-squared, with one degree of freedom less for each d than there are runs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.block_angular import block_angular
from mjfish.data import Trial
from mjfish.diagnosis.by_run import ByRun
from mjfish.diagnosis.evidence import Evidence, unscored
from mjfish.diagnosis.refit_result import Refit
from mjfish.estimation.fit import End, fit_at
from mjfish.estimation.residual import own_parameters


def of_all_runs(model: Refit | Evidence, held_out: tuple[Trial, ...]) -> Evidence:
    """Return what a fitted model leaves in its runs and in held-out ones, by one step; no candidate is scored."""
    others = [replace(trial, sensors=()) if trial.measured.any() else trial for trial in held_out]
    own = own_parameters(model.problem, model.fit.values, others)  # a first sample is no place to linearise about
    every = replace(model.problem, trials=(*model.problem.trials, *others), windows=None)
    x = every.start({**own, **model.fit.values})
    resting = {p.name for p, at_bound in zip(model.fit.parameters, model.fit.at_bound, strict=True) if at_bound}
    at_bound = np.array([p.name in resting for p in every.parameters])
    return unscored(every, fit_at(every, End(x, x, at_bound, "converged", "", 0, np.nan)))


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
