"""The conclusion: the verdict, the model that is shown with it, the forms of what is named, and its domain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.compared import Compared
from mjfish.diagnosis.forms import NamedMechanism, named_mechanisms, simpler, staying
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.isolability import explaining_domain
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.verdict import Decision, decide_beside, errs, message_of, with_random
from mjfish.effects import Effect
from mjfish.effects.mechanism import Domain


@dataclass(frozen=True, eq=False)
class Conclusion:
    """What follows from the comparison of the candidates.

    Attributes:
        decision: the verdict with the sets of causes it rests on.
        best: the refit that is shown; None: the nominal model.
        mechanisms: of the named causes, as deep as the data say them.
        domain: of sets that the data cannot tell apart, or of what no cause explains, where it has one.
    """

    decision: Decision
    best: Refit | None
    mechanisms: tuple[NamedMechanism, ...]
    domain: Domain | None


def conclude(begun: Begun, screening: Screening, compared: Compared, held_out: HeldOut) -> Conclusion:
    """Decide, and look at what follows for the model, the form of the causes and their domain.

    Args:
        begun: what the diagnosis started with.
        screening: of the nominal model.
        compared: the candidates.
        held_out: what refits predict of the held-out trials.
    """
    parts, refits = begun.parts, compared.refits
    decision = decide_beside(compared.table)
    closest = None if compared.table.blocks else compared.table.single.closest()  # what fits misread data says nothing
    best = refits.get(decision.sets[0] if decision.sets else () if closest is None else closest.names)
    mechanisms: tuple[NamedMechanism, ...] = ()
    domain = _shared_domain(decision, {effect.name: effect for effect in begun.candidates})
    if decision.verdict == "named" and best is not None:
        decision, best, mechanisms = _with_form(begun, screening, compared, held_out, decision)
    if decision.verdict == "unexplained":
        if compared.odd is not None:
            run = screening.evidence.problem.trials[compared.odd].name
            decision = replace(
                decision,
                message=f"Something was wrong in run {run} alone, and no known cause explains it; repeat that run.",
            )
        domain = parts.run("the domain", lambda: explaining_domain(screening.evidence, begun.learnable), None)
        if best is not None and held_out.trials and (why := _misleading(best, held_out)):
            told = compared.odd is None and closest is not None and closest.fits() and closest.fails()
            decision, best = replace(decision, message=decision.message + ("" if told else why)), None
    return Conclusion(with_random(decision, compared.table), best, mechanisms, domain)


def _with_form(
    begun: Begun, screening: Screening, compared: Compared, held_out: HeldOut, decision: Decision
) -> tuple[Decision, Refit, tuple[NamedMechanism, ...]]:
    """Return a decision that names a cause, with the formulas that stay, the best of these, and the mechanisms."""
    best = compared.refits[decision.sets[0]]
    own = (refit for refit in compared.learned.values() if refit.mechanisms == best.mechanisms)
    form = next(own, None) if len(best.effects) == 1 else None
    formulas = [compared.refits[names] for names in decision.sets if not compared.refits[names].learned]
    retained = staying(formulas, form) or (best if form is None else form,)
    shown, rows = retained[0], {row.names: row for row in compared.table.rows}
    others = (refit for refit in compared.refits.values() if refit not in retained)
    possible = (*retained, *simpler(shown, others, held_out))
    keys = [tuple(sorted(refit.names)) for refit in possible]
    judged = [rows.get(key) or Row.of(key, own) for key, own in zip(keys, possible, strict=True)]
    mechanisms: tuple[NamedMechanism, ...] = begun.parts.run(
        "the form",
        lambda: named_mechanisms(shown, possible, form, screening.evidence.fit, clean=judged[0].clean()),
        (),
    )
    message = message_of(judged, claimed=all(one.level == "form" for one in mechanisms)) + decision.remark
    return replace(decision, sets=tuple(refit.names for refit in retained), message=message), shown, mechanisms


def _misleading(closest: Refit, held_out: HeldOut) -> str:
    """Say why the nominal model is shown, where the closest errs more on the held-out runs; else nothing."""
    found = held_out.confirmed(closest, None)
    if found is None or not (found.error_ratio > 1.0 or found.misses_speed()):
        return ""
    return f" The nominal model is kept, for with {closest.names[0]} {errs(found)}."


def _shared_domain(decision: Decision, known: Mapping[str, Effect]) -> Domain | None:
    """Return the domain of sets that the data cannot tell apart, where they all have one."""
    domains = {known[name].domain for names in decision.sets for name in names}
    alike = decision.verdict == "cannot_tell" and len(decision.sets) > 1 and len(domains) == 1
    return domains.pop() if alike else None
