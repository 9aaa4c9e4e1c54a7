"""What a diagnosis starts with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mjfish.data import Dataset
from mjfish.diagnosis.failures import Parts
from mjfish.effects import Effect
from mjfish.effects.clock_wander import ClockWander
from mjfish.estimation import Problem
from mjfish.numerics.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Begun:
    """What a diagnosis starts with.

    Attributes:
        measured: the dataset as it was given.
        dataset: the same with aligned clocks of waves.
        candidates: effects, as the fish has them.
        reasons: why the dataset cannot show a candidate, by name; empty where it can.
        parts: what failed so far, and why.
        stated: (3,) standard deviations of the noise that the dataset states; None: none.
        problem: of the nominal model.
        seed: of the bootstrap of the gain.
    """

    measured: Dataset
    dataset: Dataset
    candidates: tuple[Effect, ...]
    reasons: Mapping[str, str]
    parts: Parts
    stated: FloatArray | None
    problem: Problem
    seed: int = 0

    @property
    def known(self) -> dict[str, Effect]:
        """The candidates that did not fail so far, by name."""
        return {effect.name: effect for effect in self.candidates if effect.name not in self.parts.failures}

    @property
    def applicable(self) -> tuple[Effect, ...]:
        """The formulas that the dataset can show."""
        return tuple(e for e in self.known.values() if not (e.learned or e.random or self.reasons[e.name]))

    @property
    def walks(self) -> bool:
        """Whether it is asked if the clock of the drive wanders."""
        return any(isinstance(e, ClockWander) and not self.reasons[e.name] for e in self.known.values())

    @property
    def learnable(self) -> tuple[Effect, ...]:
        """The learned forms that the dataset can show."""
        return tuple(e for e in self.known.values() if e.learned and not self.reasons[e.name])
