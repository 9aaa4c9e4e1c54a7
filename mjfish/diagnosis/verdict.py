"""The verdict: from the table of evidence to one decision, with its sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mjfish.diagnosis.failures import LISTED, folded
from mjfish.diagnosis.forms import form_in_words
from mjfish.diagnosis.held_out import Confirmation
from mjfish.diagnosis.result import Verdict
from mjfish.diagnosis.table import Comparison, Names, Row, Table, one_mechanism
from mjfish.diagnosis.thresholds import LARGEST, THRESHOLDS, Thresholds
from mjfish.effects.mechanism import MECHANISMS
from mjfish.numerics.formats import number, p_value, percent

_OTHERWISE = "its form differs from the model's, or a further cause is at work, or an unknown cause resembles it"


@dataclass(frozen=True)
class Decision:
    """A verdict with the sets of causes it rests on: the one that is named, or those that stay.

    Attributes:
        verdict: the verdict.
        sets: of causes.
        message: in a sentence.
        remark: behind it, of what is named: what it leaves, in words.
        closest: the single cause that comes closest, where none explains the misfit; else none.
    """

    verdict: Verdict
    sets: tuple[Names, ...]
    message: str
    remark: str = ""
    closest: Names = ()

    @property
    def certain(self) -> Names:
        """The causes that are at work whichever set is the truth: the named ones, or what several sets share."""
        several = shared(self.sets) if len(self.sets) > 1 else ()
        return self.sets[0] if self.verdict == "named" else several

    @property
    def rivals(self) -> tuple[Names, ...]:
        """The causes in which the sets differ, as one group; none where findings about the data block a verdict."""
        if self.verdict != "cannot_tell" or len(self.sets) < 2:
            return ()
        return (tuple(dict.fromkeys(name for names in self.sets for name in names if name not in self.certain)),)


def shared(sets: Sequence[Names]) -> Names:
    """Return the members that all sets have, in the order of the first."""
    return tuple(name for name in sets[0] if all(name in names for names in sets)) if sets else ()


def decide(table: Table, limits: Thresholds = THRESHOLDS) -> Decision:
    """Decide, by the first of these rules that applies. Random causes are added to what they say.

    - something about the data makes any verdict worthless: ``cannot_tell``;
    - the nominal model is not contradicted: ``nothing_wrong``;
    - single causes are retained that leave nothing systematic: one is ``named`` if it explains more than chance
      would, more are ``cannot_tell``;
    - combinations, and then single causes that leave little, are judged in the same way; of the latter, all that leave
      as little, or ten times as much, are retained;
    - a single cause fits best and fails on held-out trials, and others do not: ``cannot_tell``;
    - nothing is retained, but one cause explains most, perhaps in another form than the truth: ``cannot_tell``;
    - else: ``unexplained``.

    Args:
        table: the evidence.
        limits: what it is held against.

    Example:
        >>> from mjfish.diagnosis.table import Table
        >>> decide(Table(p_wrong=0.4)).verdict
        'nothing_wrong'
    """
    return with_random(decide_beside(table, limits), table)


def with_random(decision: Decision, table: Table) -> Decision:
    """Return a decision with the random causes of a table, beside which it was made."""
    if not table.random or table.blocks:
        return decision
    names = tuple(name for row in table.random for name in row.names)
    if decision.verdict == "nothing_wrong":
        return Decision("named", (names,), message_of(table.random, claimed=True))
    listed = " and ".join(f"{name} ({what})" for row in table.random for name, what in row.causes.items())
    sets = tuple((*own, *names) for own in decision.sets)
    return replace(decision, sets=sets, message=f"{decision.message} Also at work: {listed}.")


def decide_beside(table: Table, limits: Thresholds = THRESHOLDS) -> Decision:
    """Decide as `decide` does, random causes left out."""
    if table.blocks:
        return Decision("cannot_tell", (), f"These data allow no verdict: {table.blocks[0]}.")
    if table.p_wrong >= limits.alarm:
        return Decision(
            "nothing_wrong",
            (),
            f"Nothing wrong was found: the nominal model fits to within noise (p = {p_value(table.p_wrong)}).",
        )
    single = table.single
    for comparison, clean in ((single, True), (table.several or Comparison(), False), (single, False)):
        rows = comparison.retained(clean=clean, limits=limits)
        if comparison is single and not clean and rows and one_mechanism(rows):
            first = min(rows, key=lambda row: row.behind)
            tolerance = min(limits.remaining, limits.tenfold * first.remaining)
            alike = single.similar(first, tolerance, limits)
            rows = [*rows, *(row for row in alike if row not in rows)]
        if rows and one_mechanism(rows):
            return _alone(rows, limits)
        if rows:
            return Decision("cannot_tell", _sets(rows), _tied(_sets(rows)))
    if table.others is not None and (rows := table.others.retained(clean=True, limits=limits)):
        failed = single.failed(limits)
        why = failing(failed[0].held_out, limits) if failed else "fails on the held-out trials"
        choice = f"{_listed(_sets(failed))} fits best, but {why}; {_listed(_sets(rows))} explains the data too"
        return Decision("cannot_tell", _sets([*rows, *failed]), _undecided(choice))
    best = single.closest(limits)
    if best is not None and (nearly := _nearly(best, single, limits)) is not None:
        return nearly
    told, names = ("", ()) if best is None else (f"; the closest, {best.names[0]}, {_why(best, limits)}", best.names)
    return Decision("unexplained", (), f"Something is wrong that no known cause explains{told}.", closest=names)


def _sets(rows: Sequence[Row]) -> tuple[Names, ...]:
    return tuple(row.names for row in rows)


def _undecided(choice: str) -> str:
    return f"Something is wrong, but these data cannot tell what: {choice}."


def _nearly(best: Row, comparison: Comparison, limits: Thresholds) -> Decision | None:
    """Rule where no single cause leaves little: if the best explains most, and few come near; None else."""
    if best.remaining >= limits.resembles or best.fails(limits):
        return None
    similar = comparison.similar(best, limits.resembles, limits)
    if len({row.mechanisms for row in similar}) > LARGEST:
        return None
    alike = one_mechanism(similar)
    what = f"the mechanism {best.mechanisms[0]}" if alike and len(similar) > 1 else best.names[0]
    others = "" if alike else f"; also possible: {_listed(_sets(similar[1:]))}"
    explains = f"explains {percent(1.0 - best.remaining)} of it and leaves something systematic: {_OTHERWISE}"
    choice = f"{what} {explains}{others}"
    return Decision("cannot_tell", _sets(similar), _undecided(choice))


def _alone(rows: Sequence[Row], limits: Thresholds) -> Decision:
    """Rule on the only set that stays, or on sets that are forms of the same mechanisms."""
    first = rows[0]
    p = first.p_value
    if p < limits.keep:
        clean = first.clean(limits)
        left = "" if clean else f" It leaves {percent(first.remaining)} of the misfit: {_OTHERWISE}."
        return Decision("named", _sets(rows), message_of(rows, claimed=clean) + left, left)
    choice = f"{_listed([first.names])} fits, but explains no more than chance does (p = {p_value(p)})"
    return Decision("cannot_tell", (first.names,), _undecided(choice))


def _tied(sets: Sequence[Names]) -> str:
    """Say between which sets the data cannot tell, and what they share."""
    if common := shared(sets):
        rest = [tuple(name for name in names if name not in common) for names in sets]
        are = "is" if len(common) == 1 else "are"
        return (
            f"{' and '.join(common)} {are} at work; these data cannot tell whether the other cause is {_listed(rest)}."
        )
    return f"Something is wrong, but these data cannot tell {_listed(sets)} apart."


def _listed(sets: Sequence[Names]) -> str:
    return " or ".join(" with ".join(names) for names in sets)


def message_of(rows: Sequence[Row], *, claimed: bool) -> str:
    """Return what is named, in words.

    Args:
        rows: with the forms that stay, the best first.
        claimed: whether the formula of the best is claimed, where it is alone.
    """
    first = rows[0]
    name, summary = next(iter(first.causes.items()))
    if len(first.causes) > 1:
        listed = " and ".join(f"{each} ({what})" for each, what in first.causes.items())
        return f"{len(first.causes)} causes together: {listed}."
    if len(rows) == 1 and claimed and not first.learned:
        return f"The cause is {name}: {summary}."
    mechanism = first.mechanisms[0]
    formulas = [row.names[0] for row in rows if not row.learned]
    known = MECHANISMS[mechanism].summary if mechanism in MECHANISMS else summary
    return f"The mechanism is {mechanism}: {known}; {form_in_words(formulas)}."


def _why(best: Row, limits: Thresholds) -> str:
    left = f"leaves {percent(best.remaining)} of the misfit, and what it leaves is systematic"
    return left if not best.fits(limits) else failing(best.held_out, limits) if best.fails(limits) else "is rejected"


def failing(confirmation: Confirmation | None, limits: Thresholds) -> str:
    """Say that a cause fails on the held-out trials, and why."""
    return f"fails on the held-out trials{'' if confirmation is None else f': {errs(confirmation, limits)}'}"


def errs(confirmation: Confirmation, limits: Thresholds = THRESHOLDS) -> str:
    """Say how a model errs on the held-out trials, by both measures: they may disagree where noise is slow."""
    if confirmation.misses_speed(limits):
        return f"its mean speed there is {number(confirmation.speed_ratio)} times further off than without it"
    change, gained = confirmation.error_ratio - 1.0, confirmation.gained
    error = f"its nRMSE on the held-out trials is {percent(abs(change))} {'larger' if change > 0.0 else 'smaller'}"
    link = "although" if (change > 0.0) == (gained > 0.0) else "and"
    likelihood = f"{link} its log-likelihood is {number(abs(gained))} {'higher' if gained > 0.0 else 'lower'}"
    return f"{error} than without it, {likelihood}"


def withheld(decision: Decision, failures: Mapping[str, str]) -> Decision:
    """Return the decision with what failed; one that claims something is taken back."""
    if not failures:
        return decision
    listed = [f"{parts} failed ({reason})" for parts, reason in folded(failures)]
    more = [f"others failed ({len(failures)} in all)"] if len(listed) > LISTED else []
    told = "; ".join([*listed[:LISTED], *more])
    remedy = "mend what failed, or leave it out, and diagnose again"
    if decision.verdict in ("named", "nothing_wrong"):
        message = f"These data allow no verdict: {told}; {remedy}. As far as the rest goes: {decision.message}"
        return replace(decision, verdict="cannot_tell", message=message)
    return replace(decision, message=f"{decision.message} Not all was tried: {told}; {remedy}.")
