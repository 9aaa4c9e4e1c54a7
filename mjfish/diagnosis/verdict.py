"""The verdict: from comparisons of causes to one decision, with its sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mjfish.diagnosis.evidence import p_value_of
from mjfish.diagnosis.held_out import Confirmation
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import Verdict
from mjfish.diagnosis.screening import ALARM
from mjfish.diagnosis.select import LEFT, RESEMBLES, Comparison, Names
from mjfish.effects.mechanism import MECHANISMS
from mjfish.inspection import Finding

#: What is named must explain more than chance would, with this p value; that something is wrong may rest on all else.
_OWN = 0.05
#: A cause that leaves something is like rivals that leave ten times its share, or this share; at most LEFT.
_TENFOLD, _LITTLE = 10.0, 0.01
#: Most causes that something unexplained may be like.
_FEW = 3
#: Most failures that a message lists.
_TOLD = 3

_OTHERWISE = "its form differs from the model's, or a further cause is at work, or an unknown cause resembles it"


@dataclass(frozen=True)
class Decision:
    """A verdict with the sets of causes it rests on: the one that is named, or those that stay.

    Attributes:
        verdict: the verdict.
        sets: of causes.
        message: in a sentence.
        left: behind it, of what is named: what it leaves, in words.
        closest: the single cause that comes closest, where none explains the misfit; else none.
    """

    verdict: Verdict
    sets: tuple[Names, ...]
    message: str
    left: str = ""
    closest: Names = ()

    @property
    def certain(self) -> Names:
        """The causes that are at work whichever set is the truth: the named ones, or what several sets share."""
        if self.verdict == "named":
            return self.sets[0]
        return shared(self.sets) if len(self.sets) > 1 else ()

    @property
    def rivals(self) -> tuple[Names, ...]:
        """The causes in which the sets differ, as one group; none where findings about the data block a verdict."""
        if self.verdict != "cannot_tell" or len(self.sets) < 2:
            return ()
        return (tuple(dict.fromkeys(name for names in self.sets for name in names if name not in self.certain)),)


def shared(sets: Sequence[Names]) -> Names:
    """Return the members that all sets have, in the order of the first."""
    return tuple(name for name in sets[0] if all(name in names for names in sets)) if sets else ()


def decide(
    p_wrong: float,
    single: Comparison,
    several: Comparison | None,
    blocks: Sequence[Finding] = (),
    others: Comparison | None = None,
) -> Decision:
    """Decide, by the first of these rules that applies.

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
        p_wrong: p value of the nominal model.
        single: every candidate that was refitted, alone.
        several: sets of two or three; None where none was to be seen.
        blocks: findings about the data with which no verdict is worth its words.
        others: single causes without those that failed on held-out trials, where any did.
    """
    if blocks:
        return Decision("cannot_tell", (), f"These data allow no verdict: {blocks[0].message}.")
    if p_wrong >= ALARM:
        return Decision(
            "nothing_wrong", (), f"Nothing wrong was found: the nominal model fits to within noise (p = {p_wrong:.2g})."
        )
    for comparison, clean in ((single, True), (several, False), (single, False)):
        retained = comparison.retained(clean=clean) if comparison is not None else ()
        if comparison is single and not clean and retained and single.one_mechanism(retained):
            first = min(retained, key=lambda names: single.standings[names].behind)
            tolerance = min(LEFT, max(_TENFOLD * single.standings[first].left, _LITTLE))
            retained = tuple(dict.fromkeys((*retained, *single.similar(first, tolerance))))
        if comparison is not None and retained and comparison.one_mechanism(retained):
            return _alone(retained, comparison)
        if retained:
            return Decision("cannot_tell", retained, _tied(retained))
    best = single.closest()
    if others is not None and (retained := others.retained(clean=True)):
        failed = single.failed()
        why = _failing(single.held_out[failed[0]]) if failed else "fails on the held-out trials"
        choice = f"{_listed(failed)} fits best, but {why}; {_listed(retained)} explains the data too"
        return Decision(
            "cannot_tell", (*retained, *failed), f"Something is wrong, but these data cannot tell what: {choice}."
        )
    if best and (nearly := _nearly(best, single)) is not None:
        return nearly
    closest = f"; the closest, {best[0]}, {_why(best, single)}" if best else ""
    return Decision("unexplained", (), f"Something is wrong that no known cause explains{closest}.", closest=best)


def _nearly(best: Names, comparison: Comparison) -> Decision | None:
    """Rule where no single cause leaves little: if the best explains most, and few come near; None else."""
    if not comparison.standings[best].resembles or comparison.fails(best):
        return None
    similar = comparison.similar(best, RESEMBLES)
    if len(similar) > _FEW:
        return None
    alike = comparison.one_mechanism(similar)
    what = f"the mechanism {comparison.refits[best].mechanisms[0]}" if alike and len(similar) > 1 else _listed(similar)
    share = 1.0 - comparison.standings[best].left
    choice = f"{what} explains {share:.0%} of it and leaves something systematic: {_OTHERWISE}"
    return Decision("cannot_tell", similar, f"Something is wrong, but these data cannot tell what: {choice}.")


def _alone(sets: Sequence[Names], comparison: Comparison) -> Decision:
    """Rule on the only set that stays, or on sets that are forms of the same mechanisms."""
    names = sets[0]
    refit, standing = comparison.refits[names], comparison.standings[names]
    p = p_value_of(refit.gain, refit.degrees_of_freedom)
    if p < _OWN:
        left = "" if standing.clean else f" It leaves {standing.left:.1%} of the misfit: {_OTHERWISE}."
        message = message_of([comparison.refits[each] for each in sets], claimed=standing.clean)
        return Decision("named", tuple(sets), message + left, left)
    choice = f"{_listed([names])} fits, but explains no more than chance does (p = {p:.2g})"
    return Decision("cannot_tell", (names,), f"Something is wrong, but these data cannot tell what: {choice}.")


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


def message_of(refits: Sequence[Refit], *, claimed: bool) -> str:
    """Return what is named, in words.

    Args:
        refits: with the forms that stay, the best first.
        claimed: whether the formula of the best is claimed, where it is alone.
    """
    refit = refits[0]
    if len(refit.effects) == 1 and (len(refits) > 1 or refit.learned or not claimed):
        mechanism = refit.mechanisms[0]
        summary = MECHANISMS[mechanism].summary if mechanism in MECHANISMS else refit.effects[0].summary
        formulas = [other.names[0] for other in refits if not other.learned]
        form = f"its form may be {' or '.join(formulas)}" if formulas else "no formula fits, its form is learned"
        return f"The mechanism is {mechanism}: {summary}; {form}."
    if len(refit.effects) == 1:
        return f"The cause is {refit.names[0]}: {refit.effects[0].summary}."
    listed = " and ".join(f"{effect.name} ({effect.summary})" for effect in refit.effects)
    return f"{len(refit.effects)} causes together: {listed}."


def _why(best: Names, comparison: Comparison) -> str:
    standing = comparison.standings[best]
    if not standing.fits:
        return f"leaves {standing.left:.0%} of the misfit, and what it leaves is systematic"
    if (confirmation := comparison.held_out.get(best)) is not None and confirmation.failed:
        return _failing(confirmation)
    return "is rejected"


def _failing(confirmation: Confirmation | None) -> str:
    """Say why a cause fails on the held-out trials, by both measures: they may disagree where noise is slow."""
    if confirmation is None:
        return "fails on the held-out trials"
    change, gained = confirmation.error_ratio - 1.0, confirmation.gained
    error = f"its nRMSE on the held-out trials is {abs(change):.1%} {'larger' if change > 0.0 else 'smaller'}"
    link = "although" if (change > 0.0) == (gained > 0.0) else "and"
    likelihood = f"{link} its log-likelihood is {abs(gained):.3g} {'higher' if gained > 0.0 else 'lower'}"
    return f"fails on the held-out trials: {error} than without it, {likelihood}"


def withheld(decision: Decision, failures: Mapping[str, str]) -> Decision:
    """Return the decision with what failed; one that claims something is taken back."""
    if not failures:
        return decision
    listed = [f"{part} failed ({reason})" for part, reason in failures.items()]
    more = [f"{len(listed) - _TOLD} more failed"] if len(listed) > _TOLD else []
    told = "; ".join([*listed[:_TOLD], *more])
    remedy = "mend what failed, or leave it out, and diagnose again"
    if decision.verdict in ("named", "nothing_wrong"):
        message = f"These data allow no verdict: {told}; {remedy}. As far as the rest goes: {decision.message}"
        return replace(decision, verdict="cannot_tell", message=message)
    return replace(decision, message=f"{decision.message} Not all was tried: {told}; {remedy}.")
