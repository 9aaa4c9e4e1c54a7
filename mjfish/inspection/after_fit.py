"""Tests of the data that need the nominal fit: clocks, differentiated velocities, labels again, numbers that are known.

Clock: the measured run is compared with the simulated one shifted by whole samples; the shift may be constant, change
once, or drift. Lost frames make it change once by as many samples as were lost, which no force does.

Numbers that the data put far from what is known of them: with the rows of what is known in the fit
(`mjfish.estimation.Problem.known`), d the deviation of an estimate in units of its sd and h the leverage of its row,
the estimate without that row lies d / (1 - h) from the expected value, and

    t = d / sqrt(1 - h) = (estimate of the data - expected) / sqrt(sd^2 + se^2)

is standard normal where both are right: the deleted residual of linear regression ([Cook1982], sec. 2.2).

[Cook1982] R. Cook, S. Weisberg, Residuals and Influence in Regression.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import stats

from mjfish.data import Trial
from mjfish.effects import Effect
from mjfish.estimation import Fit, Problem
from mjfish.estimation.clocks import WALK, clocked
from mjfish.fish.frames import CHANNELS
from mjfish.inspection.before_fit import Inspection
from mjfish.inspection.finding import Finding, changed
from mjfish.inspection.nominal_simulation import labels, shifted
from mjfish.inspection.runs import sampled_enough
from mjfish.noise import DifferentiationNoise
from mjfish.numerics.arrays import FloatArray, readonly, robust_sigma

#: Shifts that are tried, in samples; a CPG goes on for a quarter of a second behind the last sample.
SHIFTS = np.arange(-6.0, 13.0)
#: A changing shift must leave less than this share of the misfit that a constant one leaves.
SHARE = 0.6
#: A run whose mean square, all three channels together, is below this one in units of sigma is on time.
_FITS = 4.0
#: Share of the samples that must lie to either side of a jump.
_SIDE = 0.08


def inspect_fit(problem: Problem, fit: Fit, effects: Mapping[str, Effect], held: Sequence[Trial] = ()) -> Inspection:
    """Check a dataset against its nominal fit.

    Args:
        problem: of the nominal model; its noise should be that of the data, coloured where they are.
        fit: of it.
        effects: the causes that may be asked for, by name.
        held: trials that were held out: they are looked at for their labels and clocks.

    Returns:
        Findings; none where the fit diverged, for then nothing can be taken away. Where no velocity was measured, only
        those about starts.
    """
    if fit.lost:
        return Inspection()
    of_velocities = _of_velocities(problem, fit, held) if problem.samples else []
    return Inspection.of([*starts_on_bounds(fit), *of_velocities], effects)


def _of_velocities(problem: Problem, fit: Fit, held: Sequence[Trial]) -> list[Finding]:
    """Return the findings about labels, clocks, runs and noise of measured velocities."""
    values = {**problem.fixed, **fit.values}
    shared = {p.name: values[p.name] for p in problem.model.parameters}
    sigma = np.median([robust_sigma(r) for r in problem.raw(fit.x)], axis=0) + 1e-12
    trials = [trial for trial in (*problem.trials, *held) if trial.drive and sampled_enough(trial)]
    found = list(labels(problem.model, trials, [shared], sigma))
    wrong = {name for finding in found for name in finding.trials}
    for trial in trials:
        if trial.name not in wrong and not (problem.walk and trial in held):  # nobody knows its walk
            offset = values.get(f"{trial.name}:clock.offset", 0.0)
            predicted = shifted(problem.model, clocked(trial, values), shared, SHIFTS * trial.step, offset=offset)
            if predicted is not None:
                found += clock(trial, predicted, sigma)
    noise = problem.noise
    if isinstance(noise, DifferentiationNoise) and not any(finding.trials for finding in found):
        found.append(
            Finding(
                "velocity-differentiated",
                "remark",
                " and ".join(CHANNELS),
                "the noise has the spectrum of differentiated positions, smoothed by a filter of "
                f"{noise.window} samples (Savitzky-Golay, order {noise.degree}, or like it)",
                "noise of a velocity that was measured",
                "give the positions, which are compared as they are; a filter delays and rounds what it smooths, and "
                "one that is not centred looks like a clock offset of half its length",
                channels=CHANNELS,
            )
        )
    return found


def starts_on_bounds(fit: Fit) -> Iterator[Finding]:
    """Yield a finding for every number of a start that rests on its bound: bounds are wider than any start."""
    for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True):
        trial, _, own = p.name.rpartition(":")
        if at_bound and own.startswith("start."):
            yield Finding(
                "start-on-bound",
                "suspect",
                f"trial '{trial}', {own}",
                f"the fit rests on the bound of {fit.values[p.name]:.4g} {p.unit}",
                f"a start between {p.low:.4g} and {p.high:.4g}",
                "look at the first samples of this run: their unit and their columns, and whether they belong to it",
                trials=(trial,),
            )


def clock(trial: Trial, predicted: FloatArray, sigma: FloatArray) -> Iterator[Finding]:
    """Find a jump or a drift of the clock.

    Args:
        trial: driven by a CPG.
        predicted: (shifts, n, 3) simulated at trial.time + `SHIFTS` times the sampling interval.
        sigma: (3,) that misfits are divided by.
    """
    misfit = np.sum(((trial.velocity - predicted) / sigma) ** 2, axis=2)
    total, n = misfit.sum(axis=1), misfit.shape[1]
    side = max(int(_SIDE * n), 10)
    if n < 4 * side or not np.all(np.isfinite(total)) or total.min() < _FITS * n:
        return
    before = np.cumsum(misfit, axis=1)[:, side : n - side]
    after = total[:, None] - before
    joined = before.min(axis=0) + after.min(axis=0)
    at = int(np.argmin(joined))
    jump = int(SHIFTS[np.argmin(after[:, at])] - SHIFTS[np.argmin(before[:, at])])
    drifting, ends = _drift(misfit)
    if min(float(joined[at]), drifting) > SHARE * float(total.min()):
        return
    when, step = float(trial.time[side + at]), trial.step
    if drifting < joined[at]:
        share = (SHIFTS[ends[1]] - SHIFTS[ends[0]]) * step / float(np.ptp(trial.time))
        yield Finding(
            "clock-drift",
            "suspect",
            f"trial '{trial.name}', time",
            f"the run's clock drifts against the command by {share:+.2%}",
            "one clock, or two at the same rate",
            "correct the frame rate, or the frequency of the drive",
            trials=(trial.name,),
        )
    elif jump:
        what = f"{jump} frames were lost" if jump > 0 else f"{-jump} frames were counted twice"
        resumed = {trial.name: partial(_resumed, at=when, by=jump * step)}
        yield Finding(
            "clock-jump",
            "blocks" if abs(jump) > 1 else "suspect",
            f"trial '{trial.name}', time {when:.2f} s",
            f"about {what} there: from then on the run is {abs(jump) * step:.3f} s "
            f"{'ahead of' if jump > 0 else 'behind'} its command",
            "times that go on evenly with the command",
            "number the frames by their time stamps and say gaps = true, or cut the run there",
            trials=(trial.name,),
            corrected=partial(changed, changes=resumed) if jump > 0 else None,
        )


def _resumed(trial: Trial, at: float, by: float) -> Trial:
    """Return a trial in which frames were lost: its samples after a time [s] are later by `by`."""
    return replace(trial, time=readonly(trial.time + by * (trial.time > at)), gaps=True)


def _drift(misfit: FloatArray) -> tuple[float, tuple[int, int]]:
    """Return the least misfit with a shift that goes evenly from one to another, and the two (indices)."""
    shifts, n = misfit.shape
    share = np.linspace(0.0, 1.0, n)
    ends = [(a, b) for a in range(shifts) for b in range(shifts) if abs(a - b) > 1]
    at = (np.rint(a + (b - a) * share).astype(np.intp) for a, b in ends)
    return min((float(misfit[shift, np.arange(n)].sum()), own) for shift, own in zip(at, ends, strict=True))


#: P value of any number, corrected for how many are asked, below which it is said.
_LEVEL = 0.01
#: Leverage above which the data say nothing about a number.
_UNSEEN = 0.95


def contradicted(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Yield a finding for every number that the data alone put far from what is known of it.

    Args:
        problem: that was fitted.
        fit: of it.
    """
    rows, deviations = fit.jacobian.of_rows(slice(problem.measured, None)), -fit.residual[problem.measured :]
    left = 1.0 - np.sum((rows @ fit.covariance) * rows, axis=1)
    told = [f":{WALK}." not in problem.parameters[i].name for i in problem.with_priors]  # a walk is drawn, not known
    asked = np.array(told, dtype=np.bool_) & (left > 1.0 - _UNSEEN)
    for row in np.flatnonzero(asked):
        t = deviations[row] / np.sqrt(left[row])
        if 2.0 * stats.norm.sf(abs(t)) * np.count_nonzero(asked) < _LEVEL:
            p = problem.parameters[problem.with_priors[row]]
            alone = p.at_deviation(float(deviations[row] / left[row]))
            yield Finding(
                "far-from-known",
                "suspect",
                p.name,
                f"the data alone put it at {min(max(alone, p.low), p.high):.3g} {p.unit}".removesuffix(" -"),
                f"{p.expected:.3g} with an sd of {p.sd:.2g} ({abs(t):.1f} sd away)",
                "measure it again, give it a larger sd, or look for a cause that it makes up for",
                trials=tuple(filter(None, [p.name.rpartition(":")[0]])),
            )
