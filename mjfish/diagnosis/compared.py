"""Comparisons of sets of causes: of single ones, and of combinations where no single one suffices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.combinations import find_combinations, to_optimum
from mjfish.diagnosis.estimate import estimates
from mjfish.diagnosis.fan_out import followed
from mjfish.diagnosis.forms import refit_learned_forms
from mjfish.diagnosis.held_out import HeldOut, pooled_error
from mjfish.diagnosis.lone_run import lone_run
from mjfish.diagnosis.random_cause import random_causes
from mjfish.diagnosis.refit import lowest
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.select import Goodness, compared
from mjfish.diagnosis.servo_delay import servo_delays
from mjfish.diagnosis.table import Comparison, Names, Row, Table
from mjfish.effects import Effect
from mjfish.estimation.residual import channel_errors
from mjfish.inspection import Finding

#: Of how many formulas, the best, lower minima are looked for where none leaves nothing.
_LEADERS = 2


@dataclass(frozen=True, eq=False)
class Compared:
    """All comparisons of a diagnosis.

    Attributes:
        table: what the verdict is read from.
        refits: of all sets.
        learned: refits of learned forms, by name.
        odd: index of the run that holds all of the misfit; None where none does.
    """

    table: Table
    refits: Mapping[Names, Refit] = field(default_factory=dict)
    learned: Mapping[str, Refit] = field(default_factory=dict)
    odd: int | None = None


def compare(
    begun: Begun, screening: Screening, held_out: HeldOut, blocks: Sequence[Finding], corrections: Sequence[Row]
) -> Compared:
    """Compare the candidates with each other, and on the held-out trials; where none suffices, combine them.

    Args:
        begun: what the diagnosis started with.
        screening: of the nominal model.
        held_out: what refits predict of the held-out trials.
        blocks: findings about the data with which no verdict is worth its words.
        corrections: rows of corrections of the data.
    """
    walk = partial(random_causes, screening.evidence, screening.p_wrong)
    table = Table(
        screening.p_wrong,
        blocks=tuple(block.message for block in blocks),
        corrections=tuple(corrections),
        random=begun.parts.run("the walk of the clock", walk, tuple[Row, ...]()),
    )
    found = _compared(begun, screening, held_out, table)
    return replace(found, table=found.table.described(lambda row: _described(row, found.refits[row.names], held_out)))


def _described(row: Row, refit: Refit, held_out: HeldOut) -> Row:
    own = {p.name for effect in refit.effects for p in effect.parameters}
    return replace(
        row,
        error=pooled_error(channel_errors(refit.problem, refit.fit.x)),
        held_out_error=pooled_error(held_out.score(refit).channels) if held_out.trials else None,
        sizes={name: value for name, value in estimates(refit.fit, refit.problem.model).items() if name in own},
        delays=servo_delays(refit),
    )


def _compared(begun: Begun, screening: Screening, held_out: HeldOut, table: Table) -> Compared:
    refits: dict[Names, Refit] = {(name,): refit for name, refit in screening.refits.items()}
    if not refits:
        return Compared(table)
    refits |= _caught_up(refits)
    goodness = Goodness(begun.applicable, held_out)
    single = _singles(refits, goodness, held_out)
    if table.blocks:  # whatever else is found, no verdict is given
        return Compared(replace(table, single=single), refits)
    clear = {row.mechanisms[0] for row in single.retained(clean=True)}
    learned = refit_learned_forms(screening.evidence, begun.learnable, clear, screening.refits)
    if learned:
        refits |= {(name,): refit for name, refit in learned.items()}
        refits |= _caught_up(refits)
        learned = {name: refits[name,] for name in learned}
        single = _singles(refits, goodness, held_out)
    if not single.retained(clean=True):
        leaders = sorted((refit for refit in refits.values() if not refit.learned), key=lambda refit: -refit.adjusted)
        lower = [refit for refit in followed(lowest, leaders[:_LEADERS]) if refit.gain > refits[refit.names].gain]
        if lower:
            refits |= {refit.names: refit for refit in lower}
            single = _singles(refits, goodness, held_out)
    table = replace(table, single=single)
    if single.retained(clean=True):
        return Compared(table, refits, learned)
    odd: int | None = begun.parts.run("the search for a single run", lambda: lone_run(screening.evidence), None)
    found: tuple[Comparison | None, Mapping[Names, Refit]] = (None, {})
    if odd is None:
        every = (*begun.applicable, *begun.learnable)
        found = begun.parts.run("the combinations", lambda: _combined(single, refits, every, held_out), found)
    if failed := {row.names for row in single.failed()}:
        others = _singles({names: refit for names, refit in refits.items() if names not in failed}, goodness, held_out)
        table = replace(table, others=others)
    return Compared(replace(table, several=found[0]), {**refits, **found[1]}, learned, odd)


def _caught_up(refits: Mapping[Names, Refit]) -> dict[Names, Refit]:
    """Follow the refits that were stopped where a step more may catch up with the best; return these."""
    best = max(refits.values(), key=lambda refit: refit.adjusted)
    late = [refit for refit in refits.values() if refit.promise > best.adjusted - refit.adjusted]
    return {refit.names: refit for refit in followed(partial(to_optimum, least=best.fit.sse), late)}


def _singles(refits: Mapping[Names, Refit], goodness: Goodness, held_out: HeldOut) -> Comparison:
    """Compare single causes with each other, and on the held-out trials."""
    found = compared(refits, goodness)
    return found.with_held_out({row.names: held_out.confirmed(refits[row.names], None) for row in found.staying()})


def _combined(
    single: Comparison,
    refits: Mapping[Names, Refit],
    candidates: Sequence[Effect],
    held_out: HeldOut,
) -> tuple[Comparison | None, Mapping[Names, Refit]]:
    """Compare combinations of causes, and return their refits; None where no second cause is seen.

    Where all that stay have a learned form and fail on the held-out trials, those of formulas alone are compared.
    """
    found, own = find_combinations(refits, candidates, held_out, small=single.exhausted())
    if found is None:
        return None, {}
    formulas = {names: refit for names, refit in refits.items() if not refit.learned}
    if all(row.learned and row.fails() for row in found.staying()) and len(formulas) < len(refits):
        plain = [effect for effect in candidates if not effect.learned]
        again = _combined(single, formulas, plain, held_out)
        return (found, own) if again[0] is None else again
    return found, own
