"""All checks that need the nominal fit: what is left of the data once the simulation is taken away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjfish.arrays import FloatArray, robust_sigma
from mjfish.data import Trial
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.inspection import clock
from mjfish.inspection.design import beats
from mjfish.inspection.finding import Checks, Finding, ordered
from mjfish.inspection.guess import sampled_enough
from mjfish.inspection.labels import costs, labels
from mjfish.inspection.making import making, remarks
from mjfish.inspection.odd_run import odd_run

#: Spectra are made of runs of this many samples or more.
_LONG = 128
#: Beats after a start or a step that are left out of them.
_BEATS = 3.0


def after(problem: Problem, fit: Fit, held: Sequence[Trial] = ()) -> Checks:
    """Check a dataset against its nominal fit.

    Args:
        problem: of the nominal model; its noise should be that of the data, coloured where they are.
        fit: of it.
        held: trials that were held out: they are looked at for their labels and clocks.

    Returns:
        Findings; none where the fit diverged, for then nothing can be taken away.
    """
    if fit.status == "diverged":
        return Checks()
    values = {**problem.fixed, **fit.values}
    shared = {p.name: values[p.name] for p in problem.model.parameters}
    residuals = problem.raw(fit.x)
    sigma = np.median([robust_sigma(r) for r in residuals], axis=0) + 1e-12
    trials = [trial for trial in (*problem.trials, *held) if trial.drive and sampled_enough(trial)]
    found: list[Finding] = []
    found += _labels(problem, trials, shared, sigma)
    wrong = {name for one in found for name in one.trials}
    for trial in trials:
        if trial.name not in wrong:
            offset = values.get(f"{trial.name}:clock.offset", 0.0)
            found += clock.clock(trial, _shifted(problem, trial, shared, offset), sigma)
    wrong = {name for one in found for name in one.trials}
    found += [one for one in odd_run(problem, fit) if not wrong & set(one.trials)]
    if not wrong:
        settled = [one for i, r in enumerate(residuals) if len((one := _settled(problem, i, r))[1]) >= _LONG]
        steps = [t.step for t, _ in settled]
        found += remarks(making([r for _, r in settled], steps, [beats(t) for t, _ in settled]))
    return Checks(ordered(found))


def _settled(problem: Problem, index: int, residual: FloatArray) -> tuple[Trial, FloatArray]:
    """Return a trial and its residual without what follows a start or a step, where a misfit has every frequency."""
    trial = problem.trials[index]
    if trial.gaps:
        return trial, residual[:0]
    if not trial.drive:
        return trial, residual
    last = trial.drive[-1]
    return trial, residual[trial.time[problem.mask(index)] > last.start + _BEATS * 2.0 * np.pi / last.omega]


def _labels(problem: Problem, trials: Sequence[Trial], values: dict[str, float], sigma: FloatArray) -> list[Finding]:
    drives = list(dict.fromkeys(trial.drive for trial in trials))
    if len(drives) < 2:
        return []
    return list(labels(trials, drives, costs(problem.model, trials, drives, values, sigma=sigma), fitted=True))


def _shifted(problem: Problem, trial: Trial, values: dict[str, float], offset: float) -> FloatArray:
    """Return the prediction (shifts, n, 3) at the times of a trial, shifted by whole samples."""
    predicted = problem.model.predict(trial, values, offset=offset)
    rollout = predicted.rollout
    if rollout.status != "ok":
        return np.full((len(clock.SHIFTS), len(trial.time), 3), np.nan)
    step = trial.step
    when = problem.model.prepare(trial, values, offset=offset).time[None, :] + clock.SHIFTS[:, None] * step
    inside = np.clip(when, rollout.time[0], rollout.time[-1])
    return np.asarray(rollout.at(inside.ravel())[:, :3].reshape(*when.shape, 3))
