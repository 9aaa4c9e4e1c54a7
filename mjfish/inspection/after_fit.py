"""Tests of the data that need the nominal fit: clocks, outlying runs, differentiated velocities, labels again.

Clock: the measured run is compared with the simulated one shifted by whole samples; the shift may be constant, change
once, or drift. Lost frames make it change once by as many samples as were lost, which no force does.

Outlying run: leaving run r out moves the estimates by one Gauss-Newton step, x_-r = x + (J_-r' J_-r)^-1 J_-r' e_-r, and
the residuals with them. No fit is run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mjfish.arrays import FloatArray, checked, project_out, robust_sigma
from mjfish.data import Trial
from mjfish.effects import Effect
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.frames import CHANNELS
from mjfish.inspection.correction import resumed
from mjfish.inspection.finding import Finding
from mjfish.inspection.nominal_simulation import costs, labels, sampled_enough
from mjfish.inspection.result import Inspection
from mjfish.noise import DifferentiationNoise, Noise

#: Shifts that are tried, in samples; a CPG goes on for a quarter of a second behind the last sample.
SHIFTS = np.arange(-6, 13)
#: A changing shift must leave less than this share of the misfit that a constant one leaves.
SHARE = 0.6
#: A run whose mean square, all three channels together, is below this one in units of sigma is on time.
_FITS = 4.0
#: Share of the samples that must lie to either side of a jump.
_SIDE = 0.08
#: A whitened residual counts as this many sigma at most: one far sample makes no bad run.
_CAP = 4.0
#: How many times worse than a run of the same drive, over the stretch they share, an odd run is.
_SUSPECT = 4.0
#: How many times worse than the next worst run an odd run is that no other run can be compared with.
_REMARK = 5.0
#: Samples over which two runs of one drive are compared at least.
_COMPARED = 30


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
    found = [*starts_on_bounds(fit), *(_of_velocities(problem, fit, held) if problem.samples else ())]
    return Inspection.of(found, effects)


def _of_velocities(problem: Problem, fit: Fit, held: Sequence[Trial]) -> list[Finding]:
    """Return the findings about labels, clocks, runs and noise of measured velocities."""
    values = {**problem.fixed, **fit.values}
    shared = {p.name: values[p.name] for p in problem.model.parameters}
    sigma = np.median([robust_sigma(r) for r in problem.raw(fit.x)], axis=0) + 1e-12
    trials = [trial for trial in (*problem.trials, *held) if trial.drive and sampled_enough(trial)]
    found = _labels(problem, trials, shared, sigma)
    wrong = {name for finding in found for name in finding.trials}
    for trial in trials:
        if trial.name not in wrong:
            offset = values.get(f"{trial.name}:clock.offset", 0.0)
            found += clock(trial, _shifted(problem, trial, shared, offset), sigma)
    wrong = {name for finding in found for name in finding.trials}
    found += [finding for finding in outlying_run(problem, fit) if not wrong & set(finding.trials)]
    if not wrong:
        found += differentiated(problem.noise)
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


def _labels(problem: Problem, trials: Sequence[Trial], values: dict[str, float], sigma: FloatArray) -> list[Finding]:
    drives = list(dict.fromkeys(trial.drive for trial in trials))
    if len(drives) < 2:
        return []
    return list(labels(trials, drives, costs(problem.model, trials, drives, values, sigma=sigma), fitted=True))


def _shifted(problem: Problem, trial: Trial, values: dict[str, float], offset: float) -> FloatArray:
    """Return the prediction (shifts, n, 3) at the times of a trial, shifted by whole samples."""
    rollout = problem.model.predict(trial, values, offset=offset).rollout
    if rollout.status != "ok":
        return np.full((len(SHIFTS), len(trial.time), 3), np.nan)
    step = trial.step
    when = problem.model.prepare(trial, values, offset=offset).time[None, :] + SHIFTS[:, None] * step
    inside = np.clip(when, rollout.time[0], rollout.time[-1])
    return np.asarray(rollout.at(inside.ravel())[:, :3].reshape(*when.shape, 3))


def clock(trial: Trial, shifted: FloatArray, sigma: FloatArray) -> Iterator[Finding]:
    """Find a jump or a drift of the clock.

    Args:
        trial: driven by a CPG.
        shifted: (shifts, n, 3) simulated at trial.time + `SHIFTS` times the sampling interval.
        sigma: (3,) that misfits are divided by.
    """
    misfit = np.sum(((trial.velocity - shifted) / sigma) ** 2, axis=2)
    total = misfit.sum(axis=1)
    n = misfit.shape[1]
    side = max(int(_SIDE * n), 10)
    if n < 4 * side or not np.all(np.isfinite(total)) or total.min() < _FITS * n:
        return
    before = np.cumsum(misfit, axis=1)[:, side : n - side]
    after = total[:, None] - before
    joined = before.min(axis=0) + after.min(axis=0)
    at = int(np.argmin(joined))
    first, second = int(np.argmin(before[:, at])), int(np.argmin(after[:, at]))
    jump = int(SHIFTS[second] - SHIFTS[first])
    constant = float(total.min())
    drifting, ends = _drift(misfit)
    if min(float(joined[at]), drifting) > SHARE * constant:
        return
    step = trial.step
    when = float(trial.time[side + at])
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
        yield Finding(
            "clock-jump",
            "blocks" if abs(jump) > 1 else "suspect",
            f"trial '{trial.name}', time {when:.2f} s",
            f"about {what} there: from then on the run is {abs(jump) * step:.3f} s "
            f"{'ahead of' if jump > 0 else 'behind'} its command",
            "times that go on evenly with the command",
            "number the frames by their time stamps and say gaps = true, or cut the run there",
            trials=(trial.name,),
            corrected=partial(resumed, name=trial.name, at=when, by=jump * step) if jump > 0 else None,
        )


def _drift(misfit: FloatArray) -> tuple[float, tuple[int, int]]:
    """Return the least misfit with a shift that goes evenly from one to another, and the two (indices)."""
    shifts, n = misfit.shape
    share = np.linspace(0.0, 1.0, n)
    best, ends = np.inf, (0, 0)
    for a in range(shifts):
        for b in range(shifts):
            if abs(a - b) < 2:
                continue
            at = np.rint(a + (b - a) * share).astype(np.intp)
            here = float(misfit[at, np.arange(n)].sum())
            if here < best:
                best, ends = here, (a, b)
    return best, ends


def outlying_run(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Find a run that is far worse than the rest."""
    trials = problem.trials
    if len(trials) < 3:
        return
    small = _Others.of(problem, fit)
    worst = int(np.argmax([_size(small.residual(r, small.step(r))) for r in range(len(trials))]))
    moved = small.step(worst)
    residuals = [small.residual(r, moved) for r in range(len(trials))]
    level = np.array([_size(residual) for residual in residuals])
    twins = [(_shared(problem, residuals, worst, k), k) for k in range(len(trials)) if k != worst]
    compared = [(ratio, k) for ratio, k in twins if ratio is not None]
    if compared:
        ratio, twin = min(compared)
        if ratio > _SUSPECT:
            yield Finding(
                "outlying-run",
                "suspect",
                f"trial '{trials[worst].name}'",
                f"its misfit is {ratio:.0f} times that of '{trials[twin].name}' under the same drive, with the "
                "coefficients fitted without it",
                "runs of one drive that differ by noise alone",
                "look at this run: another clock, scale, charge of the battery, or something in its way; diagnose "
                "without it",
                trials=(trials[worst].name,),
            )
        return
    others = np.delete(level, worst)
    if level[worst] > _REMARK * others.max():
        yield Finding(
            "outlying-run-alone",
            "remark",
            f"trial '{trials[worst].name}'",
            f"its misfit per sample is {level[worst] / np.median(others):.0f} times that of the other runs, with the "
            "coefficients fitted without it; no other run has its drive",
            "misfits of one size",
            "repeat this run: alone, it cannot be told from a cause that shows only under its drive",
            trials=(trials[worst].name,),
        )


@dataclass(frozen=True, eq=False)
class _Others:
    """A fit in few numbers by run, in which the parameters of that run alone are eliminated.

    Attributes:
        velocities: (m, 3) whitened residual of every run, and (3 m, s) its derivative by the shared parameters, both
            less what its own parameters explain.
        factors: of every run, the shared derivative (k, s) and the residual (k,) in an orthonormal basis.
    """

    velocities: tuple[tuple[FloatArray, FloatArray], ...]
    factors: tuple[tuple[FloatArray, FloatArray], ...]

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> _Others:
        jacobian = fit.jacobian.chosen(~fit.at_bound).top(problem.samples)
        velocities, factors = [], []
        for rows in problem.rows_by_trial():
            own, shared = jacobian.at(np.arange(rows.start, rows.stop))
            basis, _ = np.linalg.qr(own)
            shared, e = project_out(basis, shared), project_out(basis, fit.residual[rows])
            q, r = np.linalg.qr(shared)
            velocities.append((e, shared))
            factors.append((r, q.T @ e))
        return cls(tuple(velocities), tuple(factors))

    def residual(self, r: int, step: FloatArray) -> FloatArray:
        """Return the residual (m, 3) of run r once the shared parameters have moved by a step (s,)."""
        e, shared = self.velocities[r]
        return np.asarray((e - shared @ step).reshape(-1, 3))

    def step(self, without: int) -> FloatArray:
        """Return how the shared parameters (s,) move without a run; a direction that no other run sees is not moved."""
        kept = [pair for k, pair in enumerate(self.factors) if k != without]
        design, left = (np.concatenate([pair[i] for pair in kept]) for i in (0, 1))
        return checked(np.linalg.lstsq(design, left, rcond=1e-6)[0])


def _size(residual: FloatArray) -> float:
    return float(np.mean(np.minimum(residual**2, _CAP**2)))


def _shared(problem: Problem, residuals: Sequence[FloatArray], worst: int, other: int) -> float | None:
    """Return how many times worse `worst` is than `other` while both had one drive; None where they never had."""
    until = _same_drive_until(problem.trials[worst], problem.trials[other])
    if until is None:
        return None
    here = [residuals[k][_times(problem, k, len(residuals[k])) < until] for k in (worst, other)]
    if min(len(part) for part in here) < _COMPARED:
        return None
    return _uncapped(here[0]) / max(_uncapped(here[1]), 1e-12)


def _uncapped(residual: FloatArray) -> float:
    """Mean square without the largest two per cent."""
    squares = np.sort((residual**2).ravel())
    return float(np.mean(squares[: max(int(0.98 * len(squares)), 1)]))


def _times(problem: Problem, index: int, rows: int) -> FloatArray:
    """Return the times (rows,) of the whitened rows of a trial; with gaps the first of each stretch are not counted."""
    time = problem.trials[index].time[problem.mask(index)]
    return np.asarray(time[len(time) - rows :])


def _same_drive_until(a: Trial, b: Trial) -> float | None:
    """Return until when two runs have the same drive from the start [s]; None where they differ at once."""
    if not a.drive or not b.drive or a.drive[0] != b.drive[0]:
        return None
    ends = [trial.drive[1].start if len(trial.drive) > 1 else float(trial.time[-1]) for trial in (a, b)]
    return float(a.time[-1]) if a.drive == b.drive else min(ends)


def differentiated(noise: Noise) -> Iterator[Finding]:
    """Yield the remark that the noise of the velocities is that of differentiated positions, where it is."""
    if isinstance(noise, DifferentiationNoise):
        yield Finding(
            "velocity-differentiated",
            "remark",
            " and ".join(CHANNELS),
            f"the noise has the spectrum of differentiated positions, smoothed by a filter of {noise.window} samples "
            f"(Savitzky-Golay, order {noise.degree}, or like it)",
            "noise of a velocity that was measured",
            "give the positions, which are compared as they are; a filter delays and rounds what it smooths, and one "
            "that is not centred looks like a clock offset of half its length",
            channels=CHANNELS,
        )
