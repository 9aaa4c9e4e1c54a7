"""``identify`` as one call: dataset in, fitted coefficients with what the data say about them out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.data import Dataset, Trial, load_dataset
from mjfish.errors import NUMERIC, MjfishError, reason_of
from mjfish.estimation.clocks import aligned
from mjfish.estimation.fit import Fit, fit, multistart
from mjfish.estimation.identifiability import Weakness, weaknesses
from mjfish.estimation.intervals import Intervals, intervals, posterior
from mjfish.estimation.nominal import check_enough, first_sigma, nominal_problem, white
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Agreement, Criteria, Residual, agreement, criteria, fitted, held_out
from mjfish.estimation.residual_tests import ResidualTests, residual_tests
from mjfish.estimation.sensor_noise import joints_in_words, with_sensor_noise
from mjfish.estimation.settings import Loss, Settings
from mjfish.estimation.stability import Stability, stability
from mjfish.execution import executing
from mjfish.files.plain_data import plain, unsaved
from mjfish.files.result import Result
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS
from mjfish.model.origin import with_origin
from mjfish.model.posterior import Posterior
from mjfish.noise.autoregressive import floor
from mjfish.numerics.arrays import FloatArray, robust_sigma

#: Of the JSON of an identification.
SCHEMA = 3
#: Most lines of a summary.
_SUMMARY_LINES = 10


@dataclass(frozen=True, eq=False)
class Assessment:
    """What the data say about a fit that did not diverge.

    Attributes:
        intervals: of the estimates, for residuals that are correlated in time, the plain ones beside them.
        weaknesses: what the data do not say, in words.
        agreement: per trial, channel, part of the trial and horizon.
        residual_tests: whether anything is left in the residuals of the fit.
        criteria: AIC, AICc, BIC, FPE.
        stability: whether one set of coefficients serves all trials.
        residuals: of fitted trials, then of those held out.
    """

    intervals: Intervals
    weaknesses: tuple[Weakness, ...]
    agreement: tuple[Agreement, ...]
    residual_tests: ResidualTests
    criteria: Criteria
    stability: Stability
    residuals: tuple[Residual, ...] = unsaved()


def assess(problem: Problem, fit: Fit, residuals: tuple[Residual, ...]) -> Assessment | None:
    """Assess a fit; None where it diverged or failed, for then the data say nothing about it.

    Args:
        problem: that was fitted.
        fit: of it.
        residuals: of its trials, then of those that had no part in it.
    """
    if fit.lost:
        return None
    return Assessment(
        residuals=residuals,
        intervals=intervals(problem, fit),
        weaknesses=weaknesses(fit),
        agreement=tuple(agreement(residuals)),
        residual_tests=residual_tests(problem, fit),
        criteria=criteria(problem, fit),
        stability=stability(problem, fit),
    )


@dataclass(frozen=True)
class TrialScore:
    """nRMSE of one trial, (surge, sway, yaw_rate); NaN of what was not measured."""

    trial: str
    role: str
    nrmse: tuple[float, float, float]


@dataclass(frozen=True)
class SensorScore:
    """Agreement of one channel of one sensor of a trial: the RMSE in its unit, and over the range of the channel."""

    trial: str
    role: str
    sensor: str
    channel: str
    unit: str
    samples: int
    rmse: float
    nrmse: float


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """Fitted coefficients.

    Attributes:
        dataset: that was fitted.
        fit: estimates, standard errors, bounds, status.
        noise: sigma (3,) of the measured velocities that the weights are made of.
        scores: of every trial; held-out ones without what their own nuisance parameters were fitted on.
        remarks: what a reader should know.
        problem: that was fitted, with its final weights.
        starts: fits from a Latin hypercube.
        reached: share of them that reached the best optimum.
        assessment: what the data say about the fit; None where it diverged or failed.
        sensor_scores: of every channel of every sensor, scored as the velocities are.
    """

    dataset: Dataset
    fit: Fit
    noise: FloatArray
    scores: tuple[TrialScore, ...]
    remarks: tuple[str, ...]
    problem: Problem
    starts: int = 1
    reached: float = 1.0
    assessment: Assessment | None = None
    sensor_scores: tuple[SensorScore, ...] = ()

    @cached_property
    def fish(self) -> Fish:
        """The fish with what was found, and where it comes from: body, dataset, range of the runs, 95 % intervals."""
        return identified_fish(self.dataset, self.fit, self.problem.fixed, self.interval)

    @cached_property
    def posterior(self) -> Posterior | None:
        """What the fit says of the coefficients, for draws (`mjfish.sample`); None where it diverged or failed."""
        if self.assessment is None:
            return None
        return posterior(self.problem, self.fit, self.fish, self.assessment.stability.scatter, correlated=True)

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of an estimate, for residuals that are correlated; of a fit that was lost, plain."""
        return (self.fit if self.assessment is None else self.assessment.intervals).interval(name)

    @property
    def sigma(self) -> dict[str, float]:
        """The standard errors behind these intervals, by name."""
        known = None if self.assessment is None else self.assessment.intervals
        return self.fit.sigma if known is None else dict(zip(known.names, known.sigma.tolist(), strict=True))

    def summary(self) -> str:
        """Return status, errors and coefficients, a line each; at most ten."""
        fit, width = self.fit, max(len(p.name) for p in self.fit.parameters)
        head = f"{self.dataset.name}: {fit.status} after {fit.evaluations} evaluations"
        if self.starts > 1:
            head += f", {self.reached:.0%} of {self.starts} starts reached the best optimum"
        lines = [f"{head}; nRMSE of surge, sway, yaw rate:"]
        for role in ("fit", "held_out"):
            scores = [score.nrmse for score in self.scores if score.role == role]
            if scores:
                absent = "nan" if self.fit.lost else "not measured"
                columns = [[v for v in column if np.isfinite(v)] for column in zip(*scores, strict=True)]
                mean = ", ".join(f"{np.mean(column):.3f}" if column else absent for column in columns)
                lines.append(f"  {role.replace('_', ' ')} ({len(scores)} trials): {mean}")
        for name in dict.fromkeys(score.sensor for score in self.sensor_scores):
            lines.append(f"  {name}: {_listed([score for score in self.sensor_scores if score.sensor == name])}")
        shared = [k for k, p in enumerate(fit.parameters) if ":" not in p.name]
        room = _SUMMARY_LINES - len(lines)
        shown = shared if len(shared) <= room else shared[: room - 1]
        for k in shown:
            p, (low, high) = fit.parameters[k], self.interval(fit.parameters[k].name)
            bound = "  at its bound" if fit.at_bound[k] else ""
            lines.append(f"  {p.name:{width}} = {fit.x[k]:.4g} ({low:.4g} to {high:.4g}) {p.unit}{bound}")
        if len(shown) < len(shared):
            lines.append(f"  and {len(shared) - len(shown)} more; see fit.values")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the identification as plain data."""
        solution = self.fit
        return {
            "schema": SCHEMA,
            "dataset": self.dataset.name,
            "status": solution.status,
            "message": solution.message,
            "evaluations": solution.evaluations,
            "cost": solution.sse,
            "starts": self.starts,
            "reached": self.reached,
            # measured numbers, and what is known of parameters
            "samples": self.problem.numbers + solution.count - self.problem.measured,
            "noise": plain(self.noise),
            "parameters": {
                p.name: {
                    "estimate": solution.values[p.name],
                    "standard_error": self.sigma[p.name],
                    "low": self.interval(p.name)[0],
                    "high": self.interval(p.name)[1],
                    "unit": p.unit,
                    "at_bound": bool(at_bound),
                    "deviation": p.deviation(solution.values[p.name]) if p.sd is not None else None,
                }
                for p, at_bound in zip(solution.parameters, solution.at_bound, strict=True)
            },
            "correlation": {"names": [p.name for p in solution.parameters], "matrix": solution.correlation.tolist()},
            "scores": plain(self.scores),
            **({"sensor_scores": plain(self.sensor_scores)} if self.sensor_scores else {}),
            "remarks": list(self.remarks),
            "assessment": plain(self.assessment),
            "posterior": plain(self.posterior),
        }


def _listed(scores: Sequence[SensorScore]) -> str:
    """Return the mean nRMSE of the channels of one sensor, held-out trials where there are any."""
    role = "held_out" if any(score.role == "held_out" for score in scores) else "fit"
    means = {
        channel: np.mean([s.nrmse for s in scores if s.channel == channel and s.role == role])
        for channel in dict.fromkeys(score.channel for score in scores)
    }
    return f"{role.replace('_', ' ')}: " + ", ".join(f"{channel} {mean:.3f}" for channel, mean in means.items())


def pose(dataset: Dataset, settings: Settings | None = None) -> Problem:
    """Return the least-squares problem of a dataset's fit trials, weighted by the stated noise or a first guess of it.

    Raises:
        UnknownNameError, ParameterError: see `Settings.choose`.
        InputError: fewer data than parameters, or see `Settings.choose`.
    """
    dataset = aligned(dataset)
    settings = settings or Settings()
    fitted, _ = dataset.split()
    noise = dataset.noise if dataset.noise is not None else first_sigma(fitted)
    problem = nominal_problem(dataset, fitted, white(settings.sigma(noise)))
    fixed, declared = settings.choose(problem.parameters)
    problem = replace(problem, fixed=fixed, declared={**problem.declared, **declared})
    check_enough(problem, dataset.name)
    return problem


def identify(
    dataset: Dataset | str | Path,
    settings: Settings | None = None,
    *,
    starts: int | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    tell: Callable[[float], None] | None = None,
) -> Identification:
    """Fit the nine coefficients to all fit trials at once ([Yu2016] eq. (21)).

    Minimised is the sum over trials, samples and channels of ((measured - simulated) / sigma)^2, with velocities in m/s
    and rad/s. sigma is the stated noise, or else the RMS of the residual, with which the fit is repeated twice.

    Args:
        dataset: the trials, or the folder of ``dataset.toml``; fit trials are fitted, the others scored.
        settings: of the fit (`mjfish.estimation.Settings`); None: everything free, 16 starts.
        starts: number of starts, in place of that of the settings.
        jobs: threads; the result does not depend on them.
        executor: `concurrent.futures.Executor` that takes the starts in place of the threads, such as one of Dask.
        tell: called with the share of the starts that is done.

    Returns:
        Estimates with intervals, scores of every trial, and what the data say about the fit. Its ``fit.status`` says
        whether it converged.

    Raises:
        InputError: fewer numbers than free parameters, or a dataset that cannot be read.
        UnknownNameError: a setting names no parameter.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate("pike", ["v1", "v3-t1"], noise=(0.01, 0.01, 0.05), duration=6.0)
        >>> mjfish.identify(pool, starts=1).fit.status
        'converged'
    """
    settings = settings or Settings()
    if starts is not None:
        settings = replace(settings, starts=starts)
    with executing(jobs, executor):
        return _identified(dataset if isinstance(dataset, Dataset) else load_dataset(dataset), settings, tell)


def _identified(dataset: Dataset, settings: Settings, tell: Callable[[float], None] | None) -> Identification:
    dataset = aligned(dataset)
    trials, held = dataset.split()
    problem = pose(dataset, settings)
    robust = {"loss": settings.loss, "loss_scale": settings.loss_scale}
    many = multistart(problem, settings.starts, seed=settings.seed, tell=tell, **robust)  # type: ignore[arg-type]
    solution = many.best
    remarks = (*_of_recordings(dataset.trials), *_remarks(trials))
    weighed = dataset.noise is None and settings.weights == "noise" and any(trial.measured.any() for trial in trials)
    for _ in range(2 if weighed or problem.sensors else 0):
        if solution.lost:
            break
        if weighed:
            spread = np.maximum(_spread(problem, solution.x, settings.loss), floor(trials))
            problem = replace(problem, noise=white(spread))
        problem = with_sensor_noise(problem, solution.x)
        solution = fit(problem, solution.x, **robust)  # type: ignore[arg-type]
    if weighed:
        remarks += ("noise: none stated; the weights are the RMS of the residual",)
    for name in dict.fromkeys(sensor.name for _, sensor in problem.sensors if sensor.sigma is None):
        remarks += (f"{name}: no sigma stated; its weights are that of the third differences of the residual",)
    residuals = fitted(problem, solution.x)
    try:
        residuals += held_out(problem, solution.values, held)
    except MjfishError:
        raise
    except NUMERIC as error:
        remarks += (f"held-out trials are not scored: {reason_of(error)}",)
    found = Identification(
        dataset, solution, _measured_sigma(problem), tuple(_score(residual) for residual in residuals),
        remarks, problem, settings.starts, many.reached, None,
        tuple(score for residual in residuals for score in _sensor_scores(residual)),
    )  # fmt: skip
    try:
        assessed = replace(
            found,
            remarks=(*remarks, *joints_in_words(problem)),
            assessment=assess(problem, solution, residuals),
        )
        _ = assessed.posterior  # computed now, where its failure can still be said
    except MjfishError:
        raise
    except NUMERIC as error:
        why = f"it {solution.status}, but what the data say about it cannot be computed: {reason_of(error)}"
        return replace(found, fit=replace(solution, status="failed", message=why))
    return assessed


def _measured_sigma(problem: Problem) -> FloatArray:
    """Return the sigma (3,) of the weights, NaN of velocities that no trial measured."""
    measured = np.any([trial.measured for trial in problem.trials], axis=0)
    return np.asarray(problem.noise.sigma) if measured.all() else np.where(measured, problem.noise.sigma, np.nan)


def _spread(problem: Problem, x: FloatArray, loss: Loss) -> FloatArray:
    """Return the sigma (3,) of what a fit leaves: the RMS, or where outliers are expected 1.4826 of the median.

    NaN of velocities that no trial measured.
    """
    measured, raw = [trial.measured for trial in problem.trials], problem.raw(x)
    found = np.full(len(CHANNELS), np.nan)
    for channel in np.flatnonzero(np.any(measured, axis=0)):
        own = np.concatenate([block[:, channel] for block, there in zip(raw, measured, strict=True) if there[channel]])
        found[channel] = np.sqrt(np.mean(own**2)) if loss == "linear" else robust_sigma(own)
    return found


def _of_recordings(trials: tuple[Trial, ...]) -> Iterator[str]:
    """Yield which velocities were not measured, and what was left out of sensors."""
    for trial in trials:
        if not trial.measured.all():
            absent = [name for name, there in zip(CHANNELS, trial.measured, strict=True) if not there]
            yield f"{trial.name}: {', '.join(absent)} not measured"
        yield from (f"{trial.name}: {remark}" for sensor in trial.sensors for remark in sensor.remarks)


def _remarks(trials: tuple[Trial, ...]) -> Iterator[str]:
    for trial in trials:
        for channel, spread in zip(CHANNELS, np.ptp(trial.velocity, axis=0), strict=True):
            if spread == 0.0:
                yield f"{trial.name}: {channel} does not vary; check the recording, or leave the trial out"


def _score(residual: Residual) -> TrialScore:
    rmse = _rmse(residual.values[residual.scored])
    surge, sway, yaw_rate = (rmse / np.maximum(np.ptp(residual.trial.velocity, axis=0), 1e-12)).tolist()
    return TrialScore(residual.trial.name, residual.role, (surge, sway, yaw_rate))


def _rmse(error: FloatArray) -> FloatArray:
    """Return the root mean square (c,) of errors (n, c); NaN without any."""
    return np.sqrt(np.mean(error**2, axis=0)) if len(error) else np.full(error.shape[1], np.nan)


def _sensor_scores(residual: Residual) -> Iterator[SensorScore]:
    for own in residual.sensors:
        sensor, error = own.sensor, (own.sensor.values - own.predicted)[own.scored]
        rmse = _rmse(error)
        reach = np.maximum(np.ptp(sensor.values, axis=0), 1e-12)
        for k, (channel, unit) in enumerate(zip(sensor.channels, sensor.units, strict=True)):
            yield SensorScore(
                residual.trial.name, residual.role, sensor.name, channel, unit, len(error), float(rmse[k]),
                float(rmse[k] / reach[k]),
            )  # fmt: skip


def identified_fish(
    dataset: Dataset, fit: Fit, fixed: Mapping[str, float], interval: Callable[[str], tuple[float, float]]
) -> Fish:
    """Return the fish with what was found, and where it comes from.

    What was known of its numbers beforehand stays what is known.

    Args:
        dataset: with the fish, and the trials that were fitted.
        fit: its estimates become values, the starts and bounds it had become the fish's.
        fixed: coefficients that the fit was told, with their values. Parameters of causes and of single trials are no
            part of a fish; they are left out, here and in the fit.
        interval: of an estimate, by name.
    """
    fish = dataset.fish
    declared = {p.name: p for p in (*fish.parameters, *fit.parameters) if p.name in fish.coefficient_names}
    values = {name: value for name, value in {**fixed, **fit.values}.items() if name in declared}
    changed = {name: replace(declared[name], default=v, mean=declared[name].expected) for name, v in values.items()}
    intervals = {p.name: interval(p.name) for p in fit.parameters if ":" not in p.name}
    fish = fish.with_numbers(fit.values).with_coefficients(changed)
    return with_origin(fish, dataset, f"{fit.status}: {fit.message}", intervals)
