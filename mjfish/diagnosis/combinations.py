"""Combinations of causes: forward addition with a new linearisation at every step, then dropping and swapping.

A combination is refitted, all other candidates are scored at that fit, and the best few are added one by one and
refitted. A member stays where the combination without it explains less by a margin. Combinations of the same size that
the data cannot tell apart are all kept (the lower boundary of [Ferrari2015]).

[Ferrari2015] D. Ferrari, Y. Yang, Confidence sets for model selection by F-testing, Statistica Sinica 25.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from operator import methodcaller

from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.refit import converged_in_reach, far_off, refit_with
from mjfish.diagnosis.refit_result import TOLERANCE, Refit, extended, followed
from mjfish.diagnosis.select import Goodness, compared
from mjfish.diagnosis.table import Comparison, Names, Row, share_of
from mjfish.diagnosis.thresholds import LARGEST, THRESHOLDS
from mjfish.effects.effect import Effect
from mjfish.estimation.fit import fit_or_raise
from mjfish.execution import execution

#: Sets of causes, compared, or None; and all refits.
Found = tuple[Comparison | None, Mapping[Names, Refit]]
#: Refits that are extended, and additions that are refitted for each: those whose score is `MEMBER` and this share of
#: what all candidates explain there, beyond chance; a second cause, if it is the best, always.
_BASES, _ADDED, _HALF_OF_IT = 2, 3, 0.5
#: An addition must be seen at this family-wise level,
_SEEN = 0.01
#: and the set must explain this much beyond every smaller one, and the share `table.share_of` of its gain.
MEMBER = 20.0
#: Where a single cause leaves less than `table.share_of`: a set must explain this much beyond every smaller one.
MENDED = 200.0


def find_combinations(
    refits: Mapping[Names, Refit],
    evidence: Callable[[Refit], Evidence],
    goodness: Goodness,
    *,
    small: bool = False,
    formulas: bool = False,
) -> Found:
    """Find the smallest combinations of two or three causes that explain the misfit better than all smaller ones.

    Where a single cause leaves next to nothing, the second one is small beside it. Whatever form the first has, its
    error might be mended by a second cause that is not there; hardly all of it. So nothing systematic may be left, with
    one exception: a learned form of a very strong cause has an error of its own that shows. Beside it something may be
    left, less than the second cause explains, if the held-out trials gain by it what they would if it were true.

    Args:
        refits: of single causes, and of the sets that were looked at before.
        evidence: returns that for further causes beside a refit, see `beside`.
        goodness: tests what sets leave.
        small: whether a single cause leaves next to nothing; pairs alone are looked for then.
        formulas: whether to look for pairs of formulas alone.

    Returns:
        The sets, compared, and all refits; None in place of the sets where no second cause is to be seen, or no set
        has earned all its members, or a small one leaves something.
    """
    known = dict(refits)
    found = _searched(known, evidence, goodness, small=small, formulas=formulas)
    if found is None:
        return None, known
    found = _confirmed(found, known, goodness.held_out)
    if small:
        kept = (row for row in found.staying() if row.clean() or _borne_out(row, known))
        found = Comparison({row.names: row for row in kept})
    return found if found.rows else None, known


def _borne_out(row: Row, known: Mapping[Names, Refit]) -> bool:
    """Return whether a formula beside a stronger learned form leaves less than it explains, and is borne out."""
    stronger = max((known[name,] for name in row.names if (name,) in known), key=lambda refit: refit.gain)
    return (
        stronger.learned
        and row.fits()
        and row.excess < row.gain - stronger.gain
        and row.held_out is not None
        and row.held_out.borne_out()
    )


def _searched(
    known: dict[Names, Refit],
    evidence: Callable[[Refit], Evidence],
    goodness: Goodness,
    *,
    small: bool,
    formulas: bool,
) -> Comparison | None:
    """Return the sets, not yet confirmed on the held-out trials; what was refitted is added to `known`."""
    singles = [refit for names, refit in known.items() if len(names) == 1]
    most = max((refit.gain for refit in singles), default=0.0)
    bases = _best(refit for refit in singles if not small or refit.gain >= (1.0 - share_of(refit)) * most)
    best: Comparison | None = None
    # formulas first: where they leave nothing, a learned form explains no more, and takes ten times as long
    rounds = (partial(_grown, learned=False), _grown_by_unscored, _grown)[: 2 if formulas else 3]
    for size in (2,) if small or formulas else range(2, LARGEST + 1):
        execution().meter.stage(f"looking for {size} causes at once", {2: 0.8}.get(size, 0.95))
        earned: dict[Names, Refit] = {}
        whole = max((base.gain + evidence(base).saturated_excess() for base in bases), default=0.0)
        for grown in rounds:
            known.update(grown(bases, evidence, known, whole))
            if earned := _of_size(size, known, small=small):
                best, sufficient = _judged(earned, goodness)
                if narrower := _narrower(sufficient, evidence, known, whole):
                    known.update(narrower)
                    earned = _of_size(size, known, small=small)
                    best, sufficient = _judged(earned, goodness)
                # unlike `Comparison.exhausted`, this asks neither whether they fit nor what held-out trials say
                if not sufficient and grown is _grown and any(row.leaves_little() for row in best.staying()):
                    return best
                if sufficient:
                    known.update(parts := _parts(sufficient, known))
                    if all(beats_smaller_sets(refit, known, small=small) for refit in sufficient):
                        return best
                    return compared({**_of_size(size - 1, known), **parts}, goodness)
        if (
            not earned
            or best is None
            or min((row.remaining for row in best.staying()), default=1.0) > THRESHOLDS.resembles
        ):
            return best
        bases = _best(earned.values())
    return best


def beside(candidates: Sequence[Effect], base: Refit) -> Evidence:
    """Return the evidence for further causes beside a refit: of other mechanisms, and one learned form at most."""
    learnable = {effect.mechanism for effect in candidates if effect.learned}
    taken = learnable.intersection(base.mechanisms)  # two forms of one mechanism are one cause
    left = [e for e in candidates if e.mechanism not in taken and not (base.learned and e.learned)]
    return gather(base.problem, base.fit, left)


def _best(refits: Iterable[Refit]) -> list[Refit]:
    """Return the refits to extend: the best formulas of different mechanisms, and the best learned form."""
    ranked = sorted(refits, key=lambda refit: -refit.adjusted)
    formulas: dict[Names, Refit] = {}
    for refit in ranked:
        if not refit.learned:
            formulas.setdefault(refit.mechanisms, refit)
    return [*[*formulas.values()][:_BASES], *[refit for refit in ranked if refit.learned][:1]]


def _grown(
    bases: Sequence[Refit],
    evidence: Callable[[Refit], Evidence],
    known: Mapping[Names, Refit],
    whole: float,
    *,
    learned: bool = True,
) -> dict[Names, Refit]:
    """Add what is seen best to the bases; then, to the best result less one member, what is seen best there.

    Args:
        bases, evidence, known, whole: as in `_extended`.
        learned: whether learned forms are extended and added, too.
    """
    shortlist = partial(_visible_additions, learned=learned)
    found = _extended([base for base in bases if learned or not base.learned], evidence, known, whole, shortlist)
    leader = max(found.values(), key=lambda refit: refit.gain, default=None)
    if leader is None or leader.reach <= (1.0 - THRESHOLDS.resembles) * whole:
        return found
    known = {**known, **found}
    found |= _extended(_without(leader, known), evidence, known, whole, shortlist)
    best = max(found.values(), key=lambda refit: refit.gain)
    lost = [refit for refit in found.values() if refit.mechanisms == best.mechanisms and far_off(refit.fit)]
    nearer = followed(partial(_from_the_best, best), lost if not far_off(best.fit) else [])
    return {**found, **{_names(refit): refit for refit in nearer}}


def _from_the_best(best: Refit, refit: Refit) -> Refit:
    """Fit a set once more, from the coefficients of the best set of its mechanisms and the sizes that both have."""
    start = refit.problem.start({**refit.fit.values, **best.fit.values})
    here = fit_or_raise(refit.problem, start, tolerance=TOLERANCE)
    return refit.moved(here) if here.sse < refit.fit.sse else refit


def _grown_by_unscored(
    bases: Sequence[Refit], evidence: Callable[[Refit], Evidence], known: Mapping[Names, Refit], whole: float
) -> dict[Names, Refit]:
    """Add causes of which a score says nothing to the first base, the best formula."""
    return _extended(bases[:1], evidence, known, whole, _unscored_additions)


def _judged(earned: Mapping[Names, Refit], goodness: Goodness) -> tuple[Comparison, list[Refit]]:
    """Return the comparison of sets, and those of them that leave nothing."""
    best = compared(earned, goodness)
    return best, [earned[row.names] for row in best.staying() if row.clean()]


def _narrower(
    sufficient: Sequence[Refit], evidence: Callable[[Refit], Evidence], known: Mapping[Names, Refit], whole: float
) -> dict[Names, Refit]:
    """Refit sets that have a general form with each formula that this form becomes, in its place.

    The search may have added the other causes to the general form alone.
    """
    found: dict[Names, Refit] = {}
    for refit in sufficient:
        for effect in refit.effects:
            rest = _less(refit, effect.name)
            if effect.limits and rest in known:
                formulas = partial(_named, effect.limits)
                found |= _extended([known[rest]], evidence, {**known, **found}, whole, formulas)
    return found


def _named(names: Sequence[str], after: Evidence) -> list[Effect]:
    """Return the candidates of these names."""
    return [effect for effect in after.candidates if effect.name in names]


def _extended(
    bases: Sequence[Refit],
    evidence: Callable[[Refit], Evidence],
    known: Mapping[Names, Refit],
    whole: float,
    shortlist: Callable[[Evidence], list[Effect]],
) -> dict[Names, Refit]:
    """Refit the bases with the additions of a shortlist to each.

    Those that may come near the best are followed to their optimum, if the new member may pay, and the set leave less
    than a third of `whole`, all there is to explain.
    """
    found: dict[Names, Refit] = {}
    for base in bases:
        after = evidence(base)
        chosen = shortlist(after)
        ends = {name for effect in chosen for name in effect.limits}
        new = [e for e in after.candidates if e in chosen or (e.name in ends and not after.unidentifiable(e.name))]
        for general in (False, True):  # a general form begins at the formulas that it becomes, `Effect.limits`
            round_of = [e for e in new if bool(e.limits) == general and _names(base, e.name) not in known]
            given = [[found[names] for end in e.limits if (names := _names(base, end)) in found] for e in round_of]
            for refit in extended(partial(refit_with, gained=base.gain), round_of, after, given):
                names = _names(refit)
                if names not in found or refit.gain > found[names].gain:
                    found[names] = refit
    if found:
        needed = max(max(base.gain for base in bases) + MEMBER, (1.0 - THRESHOLDS.resembles) * whole)
        worth = [refit for refit in found.values() if refit.reach > needed]
        made = converged_in_reach(worth, max(refit.gain for refit in found.values()))
        found.update({_names(refit): refit for refit in made})
    return found


def _names(refit: Refit, *more: str) -> Names:
    """Return the names of a set, and of more causes, sorted."""
    return tuple(sorted((*refit.names, *more)))


def _visible_additions(after: Evidence, *, learned: bool) -> list[Effect]:
    """Return the few additions with the best scores, if these are large enough for a refit, the best first."""
    shown = [e for e in after.candidates if after.scored(e.name) and (learned or not e.learned)]
    ranked = sorted(shown, key=lambda effect: -after.worth(effect.name))[:_ADDED]
    if not ranked or after.directed_p() > _SEEN:
        return []
    least = max(_HALF_OF_IT * after.saturated_excess(), MEMBER)
    second = ranked[:1] if len(after.problem.causes) < LARGEST - 1 else []
    return [effect for effect in ranked if effect in second or after.statistic(effect.name) >= least]


def _unscored_additions(after: Evidence) -> list[Effect]:
    """Return additions of which a score says nothing; of nested ones the narrowest."""
    formulas = (effect for effect in after.candidates if not (effect.smooth or effect.learned or effect.limits))
    return [effect for effect in formulas if effect.starts_off_null() or not after.scored(effect.name)]


def _without(refit: Refit, known: Mapping[Names, Refit]) -> list[Refit]:
    """Return the known refits of the set less one member."""
    parts = [_less(refit, out) for out in refit.names]
    return [known[part] for part in parts if part in known]


def _less(refit: Refit, out: str) -> Names:
    """Return the names of the set without one of them, sorted."""
    return tuple(sorted(name for name in refit.names if name != out))


def _parts(sufficient: Sequence[Refit], known: Mapping[Names, Refit]) -> dict[Names, Refit]:
    """Refit the sufficient combinations less one member each, where that set was not refitted yet.

    A member may have stood in for another that was added after it, and be superfluous now.
    """
    found: dict[Names, Refit] = {}
    for refit in sufficient:
        for out in refit.effects:
            names = _less(refit, out.name)
            if names not in known and names not in found:
                for part in followed(methodcaller("less", out), [refit], [names]):
                    found[names] = part
    return found


def _of_size(size: int, known: Mapping[Names, Refit], *, small: bool = False) -> dict[Names, Refit]:
    """Return the sets of this size that have earned all their members."""
    return {n: own for n, own in known.items() if len(n) == size and beats_smaller_sets(own, known, small=small)}


def beats_smaller_sets(refit: Refit, known: Mapping[Names, Refit], *, small: bool = False) -> bool:
    """Return whether a combination explains more than every smaller set, of its members or of others, by a margin.

    Two are subtracted for every further parameter: a cause of four parameters explains some noise. A smaller set that
    was stopped before its optimum counts as if it had gained what its next step promises.
    """

    def margin(other: Refit) -> float:
        return MENDED if small else max(MEMBER, max(share_of(other), share_of(refit)) * refit.gain)

    smaller = [other for names, other in known.items() if len(names) < len(refit.names)]
    return all(refit.adjusted - other.adjusted - other.promise >= margin(other) for other in smaller)


def _confirmed(found: Comparison, known: Mapping[Names, Refit], held_out: HeldOut) -> Comparison:
    """Look at sets on the held-out trials, against the best refit with one member less."""
    confirmed = {}
    for row in found.staying():
        part = max(_without(known[row.names], known), key=lambda part: part.gain, default=None)
        confirmed[row.names] = held_out.confirmed(known[row.names], part)
    return found.with_held_out(confirmed)
