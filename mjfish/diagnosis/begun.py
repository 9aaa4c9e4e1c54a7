"""What a diagnosis starts with, however often it begins anew without a candidate that failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from mjfish.arrays import FloatArray
from mjfish.data import Dataset
from mjfish.diagnosis.evidence import signatures
from mjfish.diagnosis.failures import CandidatesFailedError, Parts, blamed, raised_in
from mjfish.diagnosis.progress import Progress, silent
from mjfish.effects import Effect
from mjfish.errors import reason_of
from mjfish.estimation import Problem


@dataclass(frozen=True, eq=False)
class Begun:
    """What a diagnosis starts with.

    Attributes:
        measured: the dataset as it was given.
        dataset: the same with aligned clocks of waves.
        candidates: effects, as the fish has them.
        reasons: why the dataset cannot show a candidate, by name; empty where it can.
        failures: candidates that failed so far, and why: they are left out.
        stated: (3,) standard deviations of the noise that the dataset states; None: none.
        problem: of the nominal model.
        seed: of the bootstrap of the gain.
        progress: called with what is being done.
    """

    measured: Dataset
    dataset: Dataset
    candidates: tuple[Effect, ...]
    reasons: Mapping[str, str]
    failures: Mapping[str, str]
    stated: FloatArray | None
    problem: Problem
    seed: int = 0
    progress: Progress = silent

    @cached_property
    def parts(self) -> Parts:
        """What fails on the way."""
        return Parts(dict(self.failures))

    @cached_property
    def known(self) -> dict[str, Effect]:
        """The candidates that did not fail, by name."""
        return {effect.name: effect for effect in self.candidates if effect.name not in self.failures}

    @cached_property
    def applicable(self) -> tuple[Effect, ...]:
        """The formulas that the dataset can show."""
        return tuple(e for e in self.known.values() if not (e.learned or self.reasons[e.name]))

    @cached_property
    def learnable(self) -> tuple[Effect, ...]:
        """The learned forms that the dataset can show."""
        return tuple(e for e in self.known.values() if e.learned and not self.reasons[e.name])

    @property
    def posed(self) -> Problem:
        """The problem; refits that were kept beside what failed are not taken."""
        kept = self.problem.kept
        return self.problem if kept is None else replace(self.problem, kept=kept.without(sorted(self.failures)))

    def without(self, failed: Mapping[str, str]) -> Begun:
        """Return a new beginning, without what failed."""
        return replace(self, failures={**self.failures, **failed})


def culprits(error: Exception, begun: Begun) -> dict[str, str]:
    """Return the candidates that are to blame for an error, and why; none where it is not theirs.

    Where the error does not say, each is tried alone: at its null, and one scale off it.
    """
    left = [effect for effect in begun.known.values() if not begun.reasons[effect.name]]
    told = error.reasons if isinstance(error, CandidatesFailedError) else {raised_in(error): reason_of(error)}
    if found := {effect.name: told[effect.name] for effect in left if effect.name in told}:
        return found
    for effect in left:
        try:
            with blamed(effect.name):
                _alone(begun.problem, effect)
        except CandidatesFailedError as own:
            found[effect.name] = next(iter(own.reasons.values()))
    return found if len(found) < max(len(left), 2) else {}


def _alone(problem: Problem, effect: Effect) -> None:
    """Simulate with one candidate alone; whatever it raises is its own fault."""
    signatures(problem, {}, [effect])
    wide = replace(problem, model=problem.model.extended(effect))
    _ = wide.prior_root
    wide.residual(wide.start({p.name: p.default + p.scale for p in effect.amplitudes()}))
