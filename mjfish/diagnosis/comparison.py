"""Comparisons of sets of causes: of single ones, and of combinations where no single one suffices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.combinations import Names, find_combinations, find_small_addition, leaves_little
from mjfish.diagnosis.forms import refit_learned_forms
from mjfish.diagnosis.held_out import Confirmation, HeldOut
from mjfish.diagnosis.lone_run import lone_run
from mjfish.diagnosis.progress import Progress, part
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.select import Goodness, Standing, standings
from mjfish.effects import Effect


@dataclass(frozen=True, eq=False)
class Comparison:
    """Combinations of causes of one size, and what speaks for them.

    Attributes:
        refits: of the sets.
        standings: of the sets.
        held_out: on held-out trials, against the best set with one member less; None where there are none.
    """

    refits: Mapping[Names, Refit]
    standings: Mapping[Names, Standing]
    held_out: Mapping[Names, Confirmation | None]

    def fails(self, names: Names) -> bool:
        """Return whether a set is known to fail on the held-out trials."""
        return (confirmation := self.held_out.get(names)) is not None and confirmation.failed

    def retained(self, *, clean: bool) -> tuple[Names, ...]:
        """Return the sets in the confidence set that fit and do not fail on held-out trials, best first."""
        kept = [
            names
            for names, standing in self.standings.items()
            if standing.in_set and (standing.clean if clean else standing.fits) and not self.fails(names)
        ]
        return tuple(sorted(kept, key=lambda names: (self.refits[names].learned, self.standings[names].behind)))

    def cleanly(self) -> list[Names]:
        """Return the names, in the order of the causes, of the sets that leave nothing systematic."""
        return [self.refits[names].names for names, standing in self.standings.items() if standing.clean]

    def closest(self) -> Names:
        """Return the set that explains most of all trials, also of the held-out ones; none where there is none."""
        return min(self.standings, key=lambda names: self.standings[names].behind, default=())

    def exhausted(self) -> bool:
        """Return whether a set that stays leaves so little that no larger one can earn its members beside it."""
        return any(leaves_little(self.refits[names], self.standings[names]) for names in self.retained(clean=False))

    def one_mechanism(self, sets: Sequence[Names]) -> bool:
        """Return whether all sets are forms of the same mechanisms."""
        return len({self.refits[names].mechanisms for names in sets}) == 1

    def similar(self, names: Names, share: float) -> tuple[Names, ...]:
        """Return a set that leaves a misfit, followed by the rivals that leave at most this share of all.

        The misfit shows that the form of the set is not that of the truth. Rivals are granted the same tolerance.
        """
        refit, excess = self.refits[names], self.standings[names].excess
        most = share * (refit.gain + excess) - excess
        near = [n for n in self.refits if n != names and refit.adjusted - self.refits[n].adjusted < most]
        near = [n for n in near if not self.fails(n)]
        return (names, *sorted(near, key=lambda n: -self.refits[n].adjusted))

    def joined(self, others: Comparison | None) -> Comparison:
        """Return this comparison with the standings of others for the sets that are in their confidence set."""
        if others is None:
            return self
        retained = {names: standing for names, standing in others.standings.items() if standing.in_set}
        return Comparison(self.refits, {**self.standings, **retained}, {**self.held_out, **others.held_out})

    def falsified(self) -> bool:
        """Return whether every set in the confidence set fails on the held-out trials."""
        return all(self.fails(n) for n, standing in self.standings.items() if standing.in_set)

    def failed(self) -> tuple[Names, ...]:
        """Return the sets in the confidence set that leave nothing, yet fail on the held-out trials."""
        return tuple(
            n for n, standing in self.standings.items() if standing.in_set and standing.clean and self.fails(n)
        )


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
    if single.exhausted():
        found = find_small_addition(refits, candidates, held_out, rng)
    else:
        found = find_combinations(refits, candidates, held_out, rng, progress)
    if found is None:
        return None
    staying_sets = [names for names, standing in found.standings.items() if standing.in_set]
    confirmed = {names: held_out.confirmed(found.refits[names], found.parts[names]) for names in staying_sets}
    result = Comparison(found.refits, found.standings, confirmed)
    formulas = {name: refit for name, refit in refits.items() if not refit.learned}
    flexible = all(found.refits[names].learned for names in staying_sets)
    if flexible and result.falsified() and len(formulas) < len(refits):
        plain = [effect for effect in candidates if not effect.learned]
        return _combined(single, formulas, plain, held_out, rng, progress) or result
    return result
