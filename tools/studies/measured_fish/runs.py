"""The real fish: settings in, a diagnosis of its measured runs and the scores of both models out."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.signal import hilbert
from threadpoolctl import threadpool_limits

from mjfish.data import Dataset, Trial
from mjfish.data.importers import ImportReport, import_files
from mjfish.diagnosis import Diagnosis, Estimate, Overlay, Splits, diagnose, diagnose_splits
from mjfish.effects import Effect, catalogue, find
from mjfish.errors import InputError, UnknownNameError
from mjfish.estimation import PREFIX, Fit, Noise, Problem, fit, predict_held_out
from mjfish.files import tomlfile
from mjfish.fish import Fish
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from studies.licence import check_mit

ROOT = Path(__file__).parents[3]
SETTINGS = Path(__file__).with_name("settings.toml")
VARIABLE = "MJFISH_FISHSIM"
Which = Literal["nominal", "extended"]
MODELS: tuple[Which, ...] = ("nominal", "extended")


class Goal(tomlfile.Table):
    """What is asked of the held-out run: error of the mean speed [m/s], nRMSE of the yaw rate [-]."""

    speed: float
    yaw_rate: float


class Bounds(tomlfile.Table):
    """Start value and bounds of a coefficient; what is left out is the fish's."""

    start: float | None = None
    low: float | None = None
    high: float | None = None


class Settings(tomlfile.Table):
    """Settings of ``make real``, see the comments of settings.toml."""

    schema_: Literal[1] = Field(alias="schema")
    fit: Annotated[tuple[str, ...], Field(min_length=1)]
    held_out: Annotated[tuple[str, ...], Field(min_length=1)]
    folder: str | None = None
    noise: Literal["tracks"] | tuple[float, float, float] = "tracks"
    candidates: tuple[str, ...] = ("*",)
    start: Annotated[dict[str, Bounds], Field(default_factory=dict)]
    seed: int = 0
    splits: Annotated[int, Field(ge=1)] = 10
    goal: Goal

    def causes(self) -> dict[str, Effect]:
        """Return the causes that are tried.

        Raises:
            UnknownNameError: a pattern that fits none.
        """
        known = catalogue()
        for pattern in self.candidates:
            if not any(fnmatchcase(name, pattern) for name in known):
                raise UnknownNameError("cause", pattern, known)
        return {name: one for name, one in known.items() if any(fnmatchcase(name, p) for p in self.candidates)}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What ``make real`` found.

    Attributes:
        settings: it was made with.
        tracks: what the importer says of the files, fitted ones first.
        diagnosis: of the runs.
        splits: the same with the runs divided anew; None where nobody asked.
        without: the same without the mechanisms of what the extended model has; None where nobody asked.
    """

    settings: Settings
    tracks: ImportReport
    diagnosis: Diagnosis
    splits: Splits | None = None
    without: Diagnosis | None = None


@dataclass(frozen=True)
class Score:
    """One model on one run, over the samples that count; of a held-out run those behind its first quarter.

    Attributes:
        run, role, model: which.
        nrmse: (surge, sway, yaw_rate), RMSE over the range of the measured channel.
        speed: mean measured surge [m/s].
        error: mean simulated less mean measured surge [m/s].
    """

    run: str
    role: str
    model: str
    nrmse: tuple[float, float, float]
    speed: float
    error: float


def folder(settings: Settings) -> Path:
    """Return where the files are.

    Raises:
        InputError: nowhere; how they are got is said. Their licence is no longer MIT.
    """
    how = (
        f"{VARIABLE} must name the folder of the measured files, which are public: git clone --depth 1 "
        f"https://github.com/srl-ethz/fishsim, then make real {VARIABLE}=fishsim/Data/Markers"
    )
    named = os.environ.get(VARIABLE)
    if not named and settings.folder is None:
        raise InputError(f"{how}; it is not set")
    found = Path(named) if named else ROOT / str(settings.folder)
    for name in (*settings.fit, *settings.held_out):
        if not (found / f"markers_{name}.csv").is_file():
            raise InputError(f"{how}; there is no markers_{name}.csv in {found}")
    check_mit(found)
    return found


def with_start(fish: Fish, start: Mapping[str, Bounds]) -> Fish:
    """Return the fish with these start values and bounds.

    Raises:
        UnknownNameError: no such coefficient.
        ParameterError: empty bounds, or a start outside of them.
    """
    declared = {parameter.name: parameter for parameter in fish.parameters}
    for name in start:
        if name not in declared:
            raise UnknownNameError("coefficient", name, declared)
    return fish.with_coefficients({name: declared[name].rebound(**dict(own)) for name, own in start.items()})


def dataset(settings: Settings, files: Path) -> tuple[Dataset, ImportReport]:
    """Import the runs as ``mjfish import fishsim`` does; noise and start values come from the fitted ones alone."""
    names = (*settings.fit, *settings.held_out)
    made, tracks = import_files("fishsim", [files / f"markers_{name}.csv" for name in names], settings.held_out)
    noise = made.noise if settings.noise == "tracks" else readonly(settings.noise)
    return replace(made, noise=noise, fish=with_start(made.fish, settings.start)), tracks


def run(
    settings: Settings,
    *,
    splits: bool = False,
    jobs: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Outcome:
    """Import and diagnose; with `splits`, again with the runs divided anew, and without the causes that were found."""
    told = {} if progress is None else {"progress": progress}
    options = {"effects": settings.causes(), "seed": settings.seed, "jobs": jobs, **told}
    with threadpool_limits(1, "blas"):  # small matrices: on two cores more threads take three times as long
        made, tracks = dataset(settings, folder(settings))
        if splits:
            divided = diagnose_splits(made, settings.splits, **options)
            taken = {find(name).mechanism for name in divided.diagnosis.best}
            left = {name: one for name, one in settings.causes().items() if one.mechanism not in taken}
            without = diagnose(made, **{**options, "effects": left}) if taken else None
            return Outcome(settings, tracks, divided.diagnosis, divided, without)
        return Outcome(settings, tracks, diagnose(made, **options))


def residual(diagnosis: Diagnosis, overlay: Overlay, model: Which) -> FloatArray:
    """Return measured less simulated velocities (n, 3), NaN where nothing is scored."""
    trial = overlay.trial
    counts = Problem(diagnosis.nominal_model, (trial,), Noise.white(np.ones(3))).mask(0)
    left = np.where(counts[:, None], trial.velocity - getattr(overlay, model), np.nan)
    if overlay.held_out:
        times = trial.time[np.isfinite(left).all(axis=1)]
        left = np.where((trial.time <= times[0] + PREFIX * (times[-1] - times[0]))[:, None], np.nan, left)
    return np.asarray(left)


def scores(diagnosis: Diagnosis) -> tuple[Score, ...]:
    """Return how well both models do on every run."""
    return tuple(
        _score(overlay.trial, "held out" if overlay.held_out else "fitted", model, residual(diagnosis, overlay, model))
        for overlay in diagnosis.overlays
        for model in MODELS
    )


def _score(trial: Trial, role: str, model: str, left: FloatArray) -> Score:
    inside = np.isfinite(left).all(axis=1)
    nrmse = np.sqrt(np.mean(left[inside] ** 2, axis=0)) / np.ptp(trial.velocity, axis=0)
    surge, sway, yaw_rate = (float(number) for number in nrmse)
    speed = float(trial.velocity[inside, 0].mean())
    return Score(trial.name, role, model, (surge, sway, yaw_rate), speed, -float(left[inside, 0].mean()))


def alone(outcome: Outcome, which: Which) -> Iterator[tuple[Problem, Fit]]:
    """Fit a model to each fitted run alone, see `refitted`."""
    for trial in outcome.diagnosis.dataset.split()[0]:
        yield refitted(outcome, which, (trial,))


def refitted(outcome: Outcome, which: Which, trials: tuple[Trial, ...]) -> tuple[Problem, Fit]:
    """Fit a model to some runs, under the white noise of the tracks, which is not that of the diagnosis."""
    made = outcome.diagnosis.dataset
    assert made.noise is not None  # noqa: S101 - the importer states it
    model = outcome.diagnosis.nominal_model if which == "nominal" else outcome.diagnosis.extended_model
    problem = Problem(model, trials, Noise.white(made.noise))
    return problem, fit(problem)


def crossed(outcome: Outcome) -> Iterator[Score]:
    """Score both models, fitted to each fitted run alone, on the others: what the settings were chosen by."""
    fitted, _ = outcome.diagnosis.dataset.split()
    for which in MODELS:
        for problem, found in alone(outcome, which):
            (one,) = problem.trials
            others = tuple(trial for trial in fitted if trial is not one)
            score = predict_held_out(problem, found.values, others)
            for trial, left in zip(others, score.residuals, strict=True):
                whole = np.full_like(trial.velocity, np.nan)
                whole[np.flatnonzero(_counts(problem, trial))[-len(left) :]] = left  # the first quarter is not scored
                yield _score(trial, f"from {one.name}", which, whole)


def _counts(problem: Problem, trial: Trial) -> BoolArray:
    """Return which samples (n,) of another trial count."""
    return replace(problem, trials=(trial,)).mask(0)


def phases(outcome: Outcome, overlay: Overlay, bins: int) -> Mapping[str, FloatArray]:
    """Return the mean residual (bins, 3) of both models over the beat of the last joint, from its crest on."""
    angle = overlay.trial.joint_angle[:, -1]
    turn = np.mod(np.angle(hilbert(angle - angle.mean())) / (2.0 * np.pi), 1.0)
    index = np.minimum((turn * bins).astype(int), bins - 1)
    found = {}
    for model in MODELS:
        left = residual(outcome.diagnosis, overlay, model)
        scored = np.isfinite(left).all(axis=1)
        found[model] = np.array([left[scored & (index == k)].mean(axis=0) for k in range(bins)])
    return found


def told(outcome: Outcome) -> dict[str, Estimate]:
    """Return the extended model's estimates, but for shapes of a roll: where it is measured they play no part."""
    shapes = {parameter.name for parameter in find("roll").parameters if parameter.shape}
    return {name: one for name, one in outcome.diagnosis.extended.items() if name not in shapes}


def reached(outcome: Outcome, model: Which = "extended") -> tuple[float, float]:
    """Return the mean error of the mean speed [m/s] and nRMSE of the yaw rate over the held-out runs."""
    held = [score for score in scores(outcome.diagnosis) if score.role == "held out" and score.model == model]
    return float(np.mean([abs(one.error) for one in held])), float(np.mean([one.nrmse[2] for one in held]))
