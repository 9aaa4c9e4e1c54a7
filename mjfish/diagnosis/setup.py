"""What a reader must know of data, model and causes to understand a diagnosis, as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mjfish.data import Dataset
from mjfish.diagnosis.failures import tried
from mjfish.effects import Effect
from mjfish.estimation import Problem
from mjfish.files.plain_data import plain
from mjfish.model import Model
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior


@dataclass(frozen=True)
class CauseText:
    """What is said of a cause that may be named; see `mjfish.Effect`.

    Attributes:
        summary, mechanism, learned, source, signature, confirm: as the effect declares them.
        units: of its parameters, by full name.
        knots: full names of its parameters that are values of a smooth curve: a person reads the curve instead.
    """

    summary: str
    mechanism: str
    learned: bool
    source: str
    signature: str
    confirm: str
    units: Mapping[str, str]
    knots: tuple[str, ...]

    @classmethod
    def of(cls, effect: Effect) -> CauseText:
        """Return what is said of an effect; of one that cannot tell its priors, which is noted, without knots."""
        priors: tuple[Prior, ...] = tried([effect.name], effect.priors, ())
        return cls(
            effect.summary,
            effect.mechanism,
            effect.learned,
            effect.source,
            effect.signature,
            effect.confirm,
            {p.name: p.unit for p in effect.parameters},
            tuple(name for prior in priors if prior.learned for name in prior.parameters),
        )


@dataclass(frozen=True)
class Setup:
    """What was compared with what.

    Attributes:
        dataset: its name.
        fish: its name.
        links: how many the fish has.
        velocities: whether velocities were compared; else what sensors read.
        plannable: whether `mjfish.plan` has runs for it: in every trial all velocities were measured.
        noise: under which the fits were made, as `mjfish.noise.Noise.to_dict` has it.
        parameters: declarations of all parameters that were fitted, but for those of single trials, by name.
        causes: candidates by name.
    """

    dataset: str
    fish: str
    links: int
    velocities: bool
    plannable: bool
    noise: Mapping[str, Any]
    parameters: Mapping[str, Parameter]
    causes: Mapping[str, CauseText]

    @classmethod
    def of(cls, dataset: Dataset, problem: Problem, models: Iterable[Model], effects: Iterable[Effect]) -> Setup:
        """Return what was compared: a nominal problem, the models that were fitted, and the candidates."""
        declared = (*problem.parameters, *(p for model in models for p in model.parameters))
        return cls(
            dataset.name,
            dataset.fish.name,
            len(dataset.fish.links),
            problem.samples > 0,
            all(trial.measured.all() for trial in dataset.trials),
            plain(problem.noise),
            {p.name: p for p in declared if ":" not in p.name},
            {effect.name: CauseText.of(effect) for effect in effects},
        )

    @property
    def knots(self) -> frozenset[str]:
        """The full names of all numbers that are values of a smooth curve."""
        return frozenset(name for cause in self.causes.values() for name in cause.knots)
