"""Comparisons of sets of causes: of single ones, and of combinations where no single one suffices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.combinations import find_combinations, find_small_addition
from mjfish.diagnosis.fan_out import followed
from mjfish.diagnosis.forms import refit_learned_forms
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.lone_run import lone_run
from mjfish.diagnosis.progress import Progress, part
from mjfish.diagnosis.refit import lowest
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.select import Comparison, Goodness, Names, standings
from mjfish.effects import Effect

#: Of how many formulas, the best, lower minima are looked for where none leaves nothing.
_LEADERS = 2


@dataclass(frozen=True, eq=False)
class Compared:
    """All comparisons of a diagnosis.

    Attributes:
        single: every candidate that was refitted, alone.
        several: sets of two or three; None where none was to be seen.
        others: single causes without those that failed on held-out trials; None where none did.
        learned: refits of learned forms, by name.
        odd: index of the run that holds all of the misfit; None where none does.
    """

    single: Comparison
    several: Comparison | None = None
    others: Comparison | None = None
    learned: Mapping[str, Refit] = field(default_factory=dict)
    odd: int | None = None

    @property
    def refits(self) -> dict[Names, Refit]:
        """Refits of all sets."""
        return {**self.single.refits, **({} if self.several is None else self.several.refits)}


def compare(begun: Begun, screening: Screening, held_out: HeldOut) -> Compared:
    """Compare the candidates with each other, and on the held-out trials; where none suffices, combine them."""
    evidence, refits, rng = screening.evidence, {**screening.refits}, begun.rng
    goodness = Goodness(begun.applicable, held_out.trials)
    single = _singles(refits, goodness, held_out, rng)
    if not refits:
        return Compared(single)
    clear = {refits[name].mechanisms[0] for (name,) in single.retained(clean=True)}
    if learned := refit_learned_forms(evidence, begun.learnable, clear, refits):
        refits |= learned
        single = _singles(refits, goodness, held_out, rng)
    if single.retained(clean=True):
        return Compared(single, learned=learned)
    leaders = sorted((refit for refit in refits.values() if not refit.learned), key=lambda refit: -refit.adjusted)
    lower = [refit for refit in followed(lowest, leaders[:_LEADERS]) if refit.gain > refits[refit.names[0]].gain]
    if lower:
        refits |= {refit.names[0]: refit for refit in lower}
        single = _singles(refits, goodness, held_out, rng)
        if single.retained(clean=True):
            return Compared(single, learned=learned)
    odd: int | None = begun.parts.run("the search for a single run", lambda: lone_run(evidence), None)
    several = others = None
    if odd is None:
        every, beside = (*begun.applicable, *begun.learnable), part(begun.progress, 0.8, 0.15)
        several = begun.parts.run(
            "the combinations", lambda: _combined(single, refits, every, held_out, rng, beside), None
        )
    if failed := single.failed():
        others = _singles({n: refit for n, refit in refits.items() if (n,) not in failed}, goodness, held_out, rng)
    return Compared(single, several, others, learned, odd)


def _singles(
    refits: Mapping[str, Refit], goodness: Goodness, held_out: HeldOut, rng: np.random.Generator
) -> Comparison:
    """Compare single causes with each other, and on the held-out trials."""
    found = standings(refits, goodness, held_out, rng) if refits else {}
    return Comparison(
        {(name,): refit for name, refit in refits.items()},
        {(name,): standing for name, standing in found.items()},
        {(name,): held_out.confirmed(refits[name], None) for name, standing in found.items() if standing.in_set},
    )


def _combined(
    single: Comparison,
    refits: Mapping[str, Refit],
    candidates: Sequence[Effect],
    held_out: HeldOut,
    rng: np.random.Generator,
    progress: Progress,
) -> Comparison | None:
    """Compare combinations of causes; None where no second cause is seen.

    Where all that stay have a learned form and fail on the held-out trials, those of formulas alone are compared.
    """
    found = (
        find_small_addition(refits, candidates, held_out, rng)
        if single.exhausted()
        else find_combinations(refits, candidates, held_out, rng, progress)
    )
    if found is None:
        return None
    formulas = {name: refit for name, refit in refits.items() if not refit.learned}
    flexible = all(found.refits[names].learned for names, standing in found.standings.items() if standing.in_set)
    if flexible and found.falsified() and len(formulas) < len(refits):
        plain = [effect for effect in candidates if not effect.learned]
        return _combined(single, formulas, plain, held_out, rng, progress) or found
    return found
