"""The models that planning starts from: as a diagnosis fitted them, and fitted here only where it did not."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset
from mjfish.design.result import Question
from mjfish.diagnosis import Diagnosis, FittedModel
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.progress import Progress
from mjfish.diagnosis.result import SCHEMA
from mjfish.diagnosis.starts import guesses, off_null
from mjfish.effects import Effect, catalogue
from mjfish.errors import InputError
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.noise import estimate
from mjfish.estimation.report import first_sigma
from mjfish.estimation.smoothing import Differentiator
from mjfish.model import Model
from mjfish.noise.restore import restore

_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class FittedModels:
    """A dataset, and what is known of the models that may explain it.

    Attributes:
        dataset: as it was fitted: waves with a clock of their own are aligned.
        effects: candidates by name.
        problem: of the nominal model, with the noise.
        question: what the diagnosis leaves open; None without a diagnosis.
        fits: by the names of their causes; empty without a diagnosis.
    """

    dataset: Dataset
    effects: Mapping[str, Effect]
    problem: Problem
    question: Question | None = None
    fits: Mapping[tuple[str, ...], FittedModel] = field(default_factory=dict)

    @classmethod
    def undiagnosed(cls, dataset: Dataset, effects: Mapping[str, Effect], jobs: int | None) -> FittedModels:
        """Return a dataset of which nothing is known but its noise, as stated, else from third differences."""
        dataset = aligned(dataset)
        sigma = first_sigma(dataset.trials) if dataset.noise is None else np.asarray(dataset.noise)
        free_clock, threads = dataset.clock == "free", jobs or os.cpu_count() or 1
        problem = Problem(Model(dataset.fish), dataset.trials, Noise.white(sigma), free_clock=free_clock, jobs=threads)
        return cls(dataset, effects, problem)

    @classmethod
    def of(cls, diagnosis: Diagnosis, jobs: int | None = None) -> FittedModels:
        """Return what a diagnosis found."""
        tried = [one for one in diagnosis.candidates if one.applicable and one.parameters]
        ranked = [one.name for one in sorted(tried, key=lambda one: -one.statistic)]
        named = [cause.name for cause in diagnosis.causes]
        question = _open_question(diagnosis.verdict, diagnosis.rivals, named, ranked)
        problem = replace(diagnosis.problem, jobs=jobs or diagnosis.problem.jobs)
        fits = {one.causes: one for one in diagnosis.fits}
        return cls(diagnosis.dataset, diagnosis.effects, problem, question, fits)

    def extended(self, effect: Effect) -> Problem:
        """Return the problem of the model with a cause, on all trials."""
        whole = self.everything
        return replace(whole, model=whole.model.extended(effect), declared={**whole.declared, **off_null(effect)})

    @property
    def everything(self) -> Problem:
        """The problem on all trials: held-out ones tell rivals apart as well as the others."""
        fitted = [trial.name for trial in self.problem.trials]
        others = (trial for trial in self.dataset.trials if trial.name not in fitted)
        return replace(self.problem, trials=(*self.problem.trials, *others), windows=None)


def load_diagnosis(
    path: str | Path, dataset: Dataset, *, effects: Mapping[str, Effect] | None = None, jobs: int | None = None
) -> FittedModels:
    """Read what a ``diagnosis.json`` says of the models that were fitted, to plan from.

    Args:
        path: written by ``mjfish diagnose --json``, or by `Diagnosis.save`.
        dataset: that was diagnosed.
        effects: causes by name, those of one's own among them; None: the shipped catalogue.
        jobs: threads; None: one a processor.

    Raises:
        InputError: the file cannot be read, is no diagnosis, is of another schema, or is one of another dataset.
    """
    remedy = f"write it by 'mjfish diagnose DATASET --json {path}'"
    try:
        raw = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {remedy}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}; {remedy}") from None
    try:
        if raw["schema"] != SCHEMA:
            raise InputError(f"{path}: has the schema {raw['schema']}, expected {SCHEMA}; {remedy} of this version")
        if raw["dataset"] != dataset.name:
            raise InputError(
                f"{path}: is the diagnosis of '{raw['dataset']}', expected that of '{dataset.name}'; give the one that "
                "belongs"
            )
        return _restored(raw, dataset, catalogue() if effects is None else effects, jobs)
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is no diagnosis: {error} is missing or wrong; {remedy}") from None


def _restored(
    raw: Mapping[str, Any], dataset: Dataset, effects: Mapping[str, Effect], jobs: int | None
) -> FittedModels:
    ranked = [c["name"] for c in sorted(raw["candidates"], key=lambda c: -c["statistic"]) if c["parameters"]]
    named = [cause["name"] for cause in raw["causes"]]
    question = _open_question(raw["verdict"], raw["rivals"], named, ranked)
    models = [
        FittedModel(**{**one, "causes": tuple(one["causes"]), "at_bound": tuple(one["at_bound"])})
        for one in raw["fits"]
    ]
    known = FittedModels.undiagnosed(dataset, effects, jobs)
    fitted, _ = known.dataset.split()
    compared = raw["problem"]
    smoothing = Differentiator(**compared["smoothing"]) if compared["smoothing"] else None
    problem = replace(
        known.problem, trials=fitted, ends=compared["ends"], slope_step=compared["slope_step"], smoothing=smoothing
    )
    values = next(one.values for one in models if not one.causes)
    problem = replace(problem, noise=restore(compared["noise"], problem, values))
    return replace(known, problem=problem, question=question, fits={one.causes: one for one in models})


@dataclass(frozen=True, eq=False)
class ModelEstimate:
    """A model at its estimates.

    Attributes:
        name: of the cause that extends the nominal model; empty for the nominal model.
        problem: on all trials.
        x: estimates (p,).
        at_bound: names of those that rest on a bound: a refit leaves them there.
        converged: whether they are an optimum.
        fitted: how many of the trials, the first ones, they were fitted to.
    """

    name: str
    problem: Problem
    x: FloatArray
    at_bound: frozenset[str]
    converged: bool
    fitted: int

    @classmethod
    def known(cls, name: str, problem: Problem, one: FittedModel, fitted: int) -> ModelEstimate:
        """Return a model as a diagnosis fitted it."""
        problem = replace(problem, model=replace(problem.model, step=one.step))
        return cls(name, problem, problem.start(one.values), frozenset(one.at_bound), one.converged, fitted)

    @classmethod
    def by_fit(cls, name: str, problem: Problem, start: FloatArray) -> ModelEstimate:
        """Fit a model."""
        return cls.of_fit(name, problem, fit(problem, start, tolerance=_TOLERANCE))

    @classmethod
    def of_fit(cls, name: str, problem: Problem, one: Fit) -> ModelEstimate:
        """Return a model at its fit."""
        held = frozenset(p.name for p, at in zip(one.parameters, one.at_bound, strict=True) if at)
        return cls(name, problem, one.x, held, one.status == "converged", len(problem.trials))


def nominal_model(known: FittedModels, progress: Progress) -> ModelEstimate:
    """Return the nominal model at its estimates; where the noise is not known, it is estimated from the residual."""
    problem = known.everything
    one = known.fits.get(())
    if one is not None and one.converged:
        return ModelEstimate.known("", problem, one, len(known.problem.trials))
    progress("fitting the nominal model", 0.1)
    found = ModelEstimate.by_fit("", problem, problem.start(None if one is None else one.values))
    return found if one is not None or known.dataset.noise is not None else _with_noise_of([found])[0]


def rival_models(known: FittedModels, rivals: Sequence[Effect], progress: Progress) -> tuple[ModelEstimate, ...]:
    """Return every rival at its estimates; fitted here where the diagnosis did not fit it, or not to its optimum."""
    there: dict[str, ModelEstimate] = {}
    for effect in rivals:
        problem = known.extended(effect)
        one = known.fits.get((effect.name,))
        if one is not None and one.converged:
            there[effect.name] = ModelEstimate.known(effect.name, problem, one, len(known.problem.trials))
        elif one is not None:
            progress(f"fitting with {effect.name}", 0.2)
            there[effect.name] = ModelEstimate.by_fit(effect.name, problem, problem.start(one.values))
    missing = [effect for effect in rivals if effect.name not in there]
    if missing:
        there |= {one.name: one for one in _from_guesses(known, missing, progress)}
    found = tuple(there[effect.name] for effect in rivals)
    return found if known.fits or known.dataset.noise is not None else _with_noise_of(found)


def _from_guesses(known: FittedModels, rivals: Sequence[Effect], progress: Progress) -> list[ModelEstimate]:
    """Fit rivals of which nothing is known, each from the best of several sizes."""
    problem, one = known.everything, known.fits.get(())
    progress("fitting the nominal model", 0.05)
    nominal = fit(problem, problem.start(None if one is None else one.values), tolerance=_TOLERANCE)
    evidence = gather(problem, nominal, rivals)
    found = []
    for done, effect in enumerate(rivals):
        progress(f"fitting with {effect.name}", 0.1 + 0.3 * done / len(rivals))
        wider = known.extended(effect)
        sizes = guesses(effect, evidence.first_guess(effect.name))
        starts = [wider.start({**nominal.values, **size}) for size in sizes]
        costs = [float(np.sum(wider.residual(start) ** 2)) for start in starts]
        found.append(ModelEstimate.by_fit(effect.name, wider, starts[int(np.argmin(costs))]))
    return found


def _with_noise_of(fitted: Sequence[ModelEstimate]) -> tuple[ModelEstimate, ...]:
    """Estimate the noise from what the best model leaves, and fit all again with it."""
    best = min(fitted, key=lambda one: float(np.sum(one.problem.residual(one.x) ** 2)))
    noise = estimate(best.problem.raw(best.x), lost=(len(best.x) - len(best.at_bound)) / 3.0)
    return tuple(ModelEstimate.by_fit(one.name, replace(one.problem, noise=noise), one.x) for one in fitted)


def _open_question(
    verdict: str, groups: Sequence[Sequence[str]], named: Sequence[str], ranked: Sequence[str]
) -> Question:
    """Return what a diagnosis leaves open.

    The rivals, where it cannot tell; what was named, or came closest, against the runner-up; where nothing is wrong, or
    only one cause was fitted, which causes more data would show.
    """
    if verdict == "nothing_wrong" or len(ranked) < 2:
        return Question("see", (), "Nothing wrong was found: the plan makes smaller effects visible.")
    group = tuple(next(iter(groups), ()))
    if verdict == "cannot_tell" and len(group) > 1:
        return Question("separate", group, f"The data cannot tell {' or '.join(group)} apart.")
    first = named[0] if named else ranked[0]
    second = next(name for name in ranked if name != first)
    what = f"{first} was named" if named else f"no cause explains the data; {first} comes closest"
    return Question("separate", (first, second), f"Verdict {verdict}: {what}, {second} is the runner-up.")
