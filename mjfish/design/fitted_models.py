"""The models that planning starts from: as a diagnosis fitted them, and fitted here only where it did not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from mjfish.data import Dataset
from mjfish.data.trial import restored_filter
from mjfish.diagnosis import Diagnosis, DiagnosisData, FittedModel, load_diagnosis
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.refit import guesses, off_null
from mjfish.effects import Causes, Effect, catalogue
from mjfish.errors import InputError
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.noise_of_fit import restore
from mjfish.estimation.nominal import first_sigma, nominal_problem
from mjfish.execution.progress import Progress
from mjfish.noise.autoregressive import estimate
from mjfish.numerics.arrays import FloatArray

_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Question:
    """What the next experiment is to answer.

    Attributes:
        purpose: ``separate`` rivals, or ``see`` causes that the data do not show.
        names: of the causes; empty with ``see``: all that apply.
        why: in a sentence.
    """

    purpose: Literal["separate", "see"]
    names: tuple[str, ...]
    why: str = ""

    def __post_init__(self) -> None:
        """Refuse rivals that are fewer than two or there twice."""
        if len(set(self.names)) < len(self.names):
            raise InputError(f"causes {', '.join(self.names)}: one is there twice; give each once")
        if self.purpose == "separate" and len(self.names) < 2:
            raise InputError(f"rivals: found {', '.join(self.names) or 'none'}, expected two or more; name another")


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
    def undiagnosed(cls, dataset: Dataset, effects: Mapping[str, Effect]) -> FittedModels:
        """Return a dataset of which nothing is known but its noise, as stated, else from third differences."""
        dataset = aligned(dataset)
        sigma = first_sigma(dataset.trials) if dataset.noise is None else np.asarray(dataset.noise)
        return cls(dataset, effects, nominal_problem(dataset, dataset.trials, Noise.white(sigma)))

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> FittedModels:
        """Return what a diagnosis found."""
        return cls(
            diagnosis.dataset,
            diagnosis.effects,
            diagnosis.problem,
            _open_question(diagnosis),
            {model.causes: model for model in diagnosis.fits},
        )

    @property
    def everything(self) -> Problem:
        """The problem on all trials: held-out ones tell rivals apart as well as the others."""
        fitted = [trial.name for trial in self.problem.trials]
        others = (trial for trial in self.dataset.trials if trial.name not in fitted)
        return replace(self.problem, trials=(*self.problem.trials, *others), windows=None)

    def extended(self, effect: Effect) -> Problem:
        """Return the problem of the model with a cause, on all trials."""
        problem = self.everything
        return replace(problem, model=problem.model.extended(effect), declared={**problem.declared, **off_null(effect)})

    def estimate(self, effect: Effect | None) -> ModelEstimate:
        """Return the model with a cause, or the nominal one, at its estimates.

        It is fitted here, to all trials, where the diagnosis did not fit it, or not to its optimum.
        """
        name, problem = ("", self.everything) if effect is None else (effect.name, self.extended(effect))
        known = self.fits.get((name,) if name else ())
        if known is None:
            found = self._nominal_fit if effect is None else self._fit_from_guesses(effect, problem)
            return ModelEstimate.of_fit(name, problem, found)
        problem = replace(problem, model=replace(problem.model, step=known.step))
        start = problem.start(known.values)
        if known.converged:
            return ModelEstimate(name, problem, start, frozenset(known.at_bound), True, len(self.problem.trials))
        return ModelEstimate.of_fit(name, problem, fit(problem, start, tolerance=_TOLERANCE))

    def estimates(self, rivals: Sequence[Effect], progress: Progress) -> tuple[ModelEstimate, ...]:
        """Return the models with every rival at their estimates; without rivals, the nominal one."""
        found = []
        for done, effect in enumerate(rivals or (None,)):
            name = "the nominal model" if effect is None else f"the model with {effect.name}"
            progress(f"fitting {name}", 0.05 + 0.4 * done / max(len(rivals), 1))
            found.append(self.estimate(effect))
        if self.fits or self.dataset.noise is not None:
            return tuple(found)
        best = min(found, key=lambda model: float(np.sum(model.problem.residual(model.x) ** 2)))
        noise = estimate(best.problem.raw(best.x), lost=(len(best.x) - len(best.at_bound)) / 3.0)
        return tuple(model.refitted(noise) for model in found)

    @cached_property
    def _nominal_fit(self) -> Fit:
        problem, known = self.everything, self.fits.get(())
        return fit(problem, problem.start(known.values if known else None), tolerance=_TOLERANCE)

    def _fit_from_guesses(self, effect: Effect, problem: Problem) -> Fit:
        """Fit a rival of which nothing is known from the best of several sizes."""
        nominal = self._nominal_fit
        first_guess = gather(self.everything, nominal, [effect]).first_guess(effect.name)
        starts = [problem.start({**nominal.values, **size}) for size in guesses(effect, first_guess)]
        start = min(starts, key=lambda x: float(np.sum(problem.residual(x) ** 2)))
        return fit(problem, start, tolerance=_TOLERANCE)


def load_fitted_models(path: str | Path, dataset: Dataset, *, effects: Causes = None) -> FittedModels:
    """Read what a ``diagnosis.json`` says of the models that were fitted, to plan from.

    Args:
        path: written by ``mjfish diagnose --json``, or by `Diagnosis.save`.
        dataset: that was diagnosed.
        effects: causes by name, or Python files with causes of your own; None: the shipped ones.

    Raises:
        InputError: as of `mjfish.load_diagnosis`, or the file is the diagnosis of another dataset.
    """
    found = load_diagnosis(path)
    if found.setup.dataset != dataset.name:
        raise InputError(
            f"{path}: is the diagnosis of '{found.setup.dataset}', expected that of '{dataset.name}'; give the one that"
            " belongs"
        )
    known = FittedModels.undiagnosed(dataset, catalogue(effects))
    fitted, _ = known.dataset.split()
    compared = found.content["problem"]
    try:
        smoothing = restored_filter(compared["smoothing"])
        problem = replace(known.problem, trials=fitted, slope_step=compared["slope_step"], smoothing=smoothing)
        problem = replace(problem, noise=restore(compared["noise"], problem, found.fits[0].values))
        return replace(known, problem=problem, question=_open_question(found), fits={m.causes: m for m in found.fits})
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise InputError(f"{path}: is of other runs than those of '{dataset.name}': {error}; diagnose them") from None


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
    def of_fit(cls, name: str, problem: Problem, found: Fit) -> ModelEstimate:
        """Return a model at its fit to all trials."""
        at_bound = frozenset(p.name for p, held in zip(found.parameters, found.at_bound, strict=True) if held)
        return cls(name, problem, found.x, at_bound, found.status == "converged", len(problem.trials))

    def refitted(self, noise: Noise) -> ModelEstimate:
        """Return the model at its fit under another noise."""
        problem = replace(self.problem, noise=noise)
        return self.of_fit(self.name, problem, fit(problem, self.x, tolerance=_TOLERANCE))


def _open_question(diagnosis: DiagnosisData) -> Question:
    """Return what a diagnosis leaves open.

    The rivals, where it cannot tell; what was named, or came closest, against the runner-up; where nothing is wrong, or
    only one cause was fitted, which causes more data would show.
    """
    alone = [row for row in diagnosis.table.rows if len(row.names) == 1]
    ranked = [row.names[0] for row in sorted(alone, key=lambda row: -row.gain)]
    named = [cause.name for cause in diagnosis.causes]
    if diagnosis.verdict == "nothing_wrong" or len(ranked) < 2:
        return Question("see", (), "Nothing wrong was found: the plan makes smaller effects visible.")
    group = next(iter(diagnosis.rivals), ())
    if diagnosis.verdict == "cannot_tell" and len(group) > 1:
        return Question("separate", group, f"The data cannot tell {' or '.join(group)} apart.")
    first = named[0] if named else ranked[0]
    second = next(name for name in ranked if name != first)
    what = f"{first} was named" if named else f"no cause explains the data; {first} comes closest"
    return Question("separate", (first, second), f"Verdict {diagnosis.verdict}: {what}, {second} is the runner-up.")
