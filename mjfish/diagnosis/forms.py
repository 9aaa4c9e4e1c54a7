"""Forms of a mechanism: which formulas stay beside the learned form, and at which level the data name it.

Formulas of a mechanism are nested, or nearly, in its learned form: a formula stays where the learned form does not beat
it by more than chance, by the likelihood ratio with the effective degrees of freedom that the learned form has more. It
is claimed only where another form of the same strength would have been seen: with the sensitivities L of the learned
form, a random form g of its prior, the projector M off the coefficients and M_f off the formula with them,

    what another form leaves = LR |M_f L g|^2 / |M L g|^2
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjfish.diagnosis.curves import MeasuredCurve, curves_of
from mjfish.diagnosis.evidence import DETECTED, Evidence, gather, p_value_of
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.isolability import prior_precision
from mjfish.diagnosis.refit import converged_in_reach, refit_with
from mjfish.diagnosis.refit_result import Refit, extended
from mjfish.effects.effect import Effect
from mjfish.effects.mechanism import MECHANISMS
from mjfish.estimation import Fit
from mjfish.numerics.block_angular import span

#: A formula is given up for the learned form below this p value.
_BEATEN = 0.01
#: A learned form is fitted where its score, or a formula of its mechanism, explains this share of the best formula;
#: and where a formula or two leave nothing: only rivals that come near these matter then.
_PROMISING, _NEAR = 0.3, 0.6
#: Beside such a formula, a learned form is taken to explain at most so many times what the best formula of its own
#: mechanism does at its refit: its score is first order, and of a strong effect promises too much.
_TIMES = 1.5
#: And followed to its optimum where its coarse refit explains this share of the best, or its next step promises that;
#: where a formula of another mechanism, or two formulas, leave nothing.
_RUNNING, _RIVAL = 0.5, 0.85
#: Draws of other forms, and the share of them that may go unseen.
_OTHERS, _UNSEEN = 400, 0.2


@dataclass(frozen=True)
class NamedMechanism:
    """What acts, as deep as the data say it.

    Attributes:
        name: of the mechanism.
        domain: where it acts.
        level: ``form`` where one formula stays alone, leaves nothing systematic, and another form would have been
            seen; else ``mechanism``.
        form: the formula that the extended model has, or ``learned``.
        forms: the formulas that stay.
        curves: the form as curves, with their bands.
    """

    name: str
    domain: str
    level: Literal["form", "mechanism"]
    form: str
    forms: tuple[str, ...]
    curves: tuple[MeasuredCurve, ...]

    @property
    def told(self) -> str:
        """What acts, and what the data say of its form, in a line."""
        return f"{self.name}: {form_in_words(self.forms, claimed=self.level == 'form')}"


def form_in_words(formulas: Sequence[str], *, claimed: bool = False) -> str:
    """Say what the data say of the form of a mechanism.

    Args:
        formulas: that stay.
        claimed: whether the only one is claimed.

    Example:
        >>> form_in_words(["servo_lag", "servo_delay"])
        'these data do not settle its form: servo_lag or servo_delay'
    """
    if not formulas:
        return "no formula fits, its form is learned"
    if claimed:
        return f"its form is {formulas[0]}"
    if len(formulas) == 1:
        return f"of the known formulas {formulas[0]} alone stays; a form that is not listed is not excluded"
    return f"these data do not settle its form: {' or '.join(formulas)}"


def refit_learned_forms(
    evidence: Evidence,
    learned: Sequence[Effect],
    settled: Iterable[str],
    refits: Mapping[str, Refit],
    sufficient: Sequence[Refit] = (),
) -> dict[str, Refit]:
    """Fit the learned forms of mechanisms that are promising together with the coefficients, by name of the cause.

    Args:
        evidence: of the nominal model.
        learned: causes of learned form.
        settled: mechanisms of which a formula leaves nothing, or next to nothing: their learned forms are fitted, and
            those near them.
        refits: of formulas, by name.
        sufficient: pairs of formulas that leave nothing, or next to nothing: learned forms near them are fitted.
    """
    if not learned:
        return {}
    known, most = set(settled), max((refit.gain for refit in (*refits.values(), *sufficient)), default=0.0)
    near, share = (True, _NEAR) if known or sufficient else (False, _PROMISING)
    scored = gather(evidence.problem, evidence.fit, learned)
    own = {e.name: [refit for refit in refits.values() if refit.mechanisms == (e.mechanism,)] for e in learned}
    promised = {e.name: _promised(e, scored, own[e.name], near=near) for e in learned}
    seen = [effect for effect in learned if effect.mechanism in known or promised[effect.name] >= share * most]
    coarse = [*extended(refit_with, seen, scored, [own[effect.name] for effect in seen])]

    def reach(refit: Refit) -> float:
        """Return the gain that no other refit may exceed if this one is to be followed."""
        if known:
            return refit.gain / (_RUNNING if refit.mechanisms[0] in known else _RIVAL)
        return (refit.gain + refit.promise) / (_RIVAL if near else _RUNNING)

    return {refit.names[0]: refit for refit in converged_in_reach(coarse, most, reach)}


def _promised(effect: Effect, evidence: Evidence, formulas: Sequence[Refit], *, near: bool) -> float:
    """Return what a learned form may explain, as its score or the best formula of its mechanism says.

    Where something leaves nothing, that is at most so many times what the best formula of its mechanism explains.
    """
    most = max((refit.gain for refit in formulas), default=0.0)
    score = evidence.statistic(effect.name) if effect.smooth and evidence.scored(effect.name) else 0.0
    return max(most, min(score, _TIMES * most) if near and formulas else score)


def staying(formulas: Sequence[Refit], learned: Refit | None) -> tuple[Refit, ...]:
    """Return the refits with a formula that the learned form of the mechanism does not beat.

    A formula that has another one as its limit is left out where that one stays.
    """
    kept = [formula for formula in formulas if learned is None or not _beats(learned, formula)]
    names = {refit.names[0] for refit in kept if len(refit.names) == 1}
    return tuple(refit for refit in kept if names.isdisjoint(refit.effects[0].limits) or len(refit.names) > 1)


def simpler(shown: Refit, refits: Iterable[Refit], held_out: HeldOut) -> tuple[Refit, ...]:
    """Return formulas of the mechanisms of a refit with fewer parameters that predict the held-out trials as well.

    By one of both measures: the likelihood of these trials is less than ten times smaller with them, or the nRMSE no
    larger. What further parameters explain of the fitted trials alone may be another cause, or an error elsewhere.

    Args:
        shown: the refit; of a learned form there are none.
        refits: others.
        held_out: what refits predict of the held-out trials.
    """
    alike = (refit for refit in refits if not refit.learned and refit.mechanisms == shown.mechanisms)
    fewer = (refit for refit in alike if refit.degrees_of_freedom < shown.degrees_of_freedom)
    found = {} if shown.learned else {refit: held_out.confirmed(shown, refit) for refit in fewer}
    return tuple(refit for refit, more in found.items() if more and more.as_well())


def _beats(learned: Refit, formula: Refit) -> bool:
    more = max(learned.degrees_of_freedom - formula.degrees_of_freedom, 1.0)
    return p_value_of(learned.gain - formula.gain, more) < _BEATEN


def remainder_of_other_forms(formula: Refit, learned: Refit) -> float:
    """Return the sum of squares that all but a few other forms of the strength of a formula would leave beside it.

    Args:
        formula: refit with the formula alone.
        learned: with the learned form of its mechanism alone.
    """
    own = [p for p in learned.effects[-1].amplitudes() if p.name not in learned.problem.fixed]
    places = {p.name: i for i, p in enumerate(learned.problem.parameters)}
    at, scales = [places[p.name] for p in own], np.array([p.scale for p in own])
    precision = prior_precision(learned.effects[-1:], own)
    unknown = ~np.any(precision, axis=0)
    values, axes = np.linalg.eigh(precision + np.diag(unknown.astype(float)))
    draws = np.random.default_rng(0).standard_normal((len(own), _OTHERS))
    forms = axes @ (draws / np.sqrt(np.maximum(values, 1e-6))[:, None])
    slopes = learned.fit.jacobian.of_columns(at) * scales
    fit, names = formula.fit, {p.name for effect in formula.effects for p in effect.parameters}
    coefficients = np.array([p.name not in names for p in fit.parameters]) & ~fit.at_bound
    beyond = (span(fit.jacobian.chosen(kept)).off(slopes) for kept in (coefficients, ~fit.at_bound))
    strength, left = (np.sum((np.linalg.qr(part, mode="r") @ forms) ** 2, axis=0) for part in beyond)
    return formula.gain * float(np.quantile(left / np.maximum(strength, 1e-300), _UNSEEN))


def named_mechanisms(
    best: Refit, retained: Sequence[Refit], form: Refit | None, nominal: Fit, *, clean: bool
) -> tuple[NamedMechanism, ...]:
    """Return the mechanisms of the named causes.

    Args:
        best: the refit that is shown.
        retained: refits of all sets that stay, of the same mechanisms.
        form: with the learned form of the mechanism, where there is one alone.
        nominal: fit of the nominal model.
        clean: whether the best leaves nothing systematic.
    """
    found = []
    for name in dict.fromkeys(effect.mechanism for effect in best.effects):
        shown = [effect for effect in best.effects if effect.mechanism == name]
        members = (member for refit in retained for member in refit.effects if not member.learned)
        forms = dict.fromkeys(member.name for member in members if member.mechanism == name)
        learned = any(effect.learned for effect in shown)
        single = clean and len(forms) == 1 and not learned
        single = single and (form is None or remainder_of_other_forms(best, form) >= DETECTED)
        known = MECHANISMS.get(name)
        found.append(
            NamedMechanism(
                name=name,
                domain=shown[0].domain if known is None else known.domain,
                level="form" if single else "mechanism",
                form="learned" if learned else shown[0].name,
                forms=tuple(forms),
                curves=curves_of(name, best if single or form is None else form, nominal),
            )
        )
    return tuple(found)
