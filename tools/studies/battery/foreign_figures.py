"""Figures of mechanisms: of foreign forms, whether the mechanism was named and no formula claimed; and their curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.effects import catalogue
from studies.battery.answers import Judged
from studies.battery.figures import TOLD_APART, Figure, apart, proportion
from studies.battery.generator.classes import CAUSES, MECHANISMS, OFF_DOMAINS
from studies.battery.generator.foreign import BY_MECHANISM, MEDIUM, drag_factor


@dataclass(frozen=True)
class CurveScore:
    """How well a measured curve is the planted one over the visited range.

    Attributes:
        error: rms of the relative error.
        nominal: that of the nominal model.
        inside: by point, whether the band has the truth.
    """

    error: float
    nominal: float
    inside: tuple[bool, ...]


def claimed(case: Judged) -> bool:
    """Return whether a formula was claimed where another law was planted."""
    twins = {twin for name in case.truth.causes for twin in CAUSES[name].twins}
    return any(one["level"] == "form" and one["form"] not in twins for one in case.answer["mechanisms"])


def false_members(case: Judged) -> frozenset[str]:
    """Return named mechanisms that are not there."""
    return case.mechanisms - {MECHANISMS.get(name, name) for name in case.truth.causes}


def in_sets(case: Judged) -> bool:
    """Return whether a set that stayed has the true mechanisms and no other."""
    wanted = {MECHANISMS.get(name, name) for name in case.truth.causes}
    return any({_mechanism(name) for name in names} == wanted for names in case.answer["alternatives"])


def _mechanism(name: str) -> str:
    """Return the mechanism of a cause of the solver's catalogue."""
    return catalogue()[name].mechanism if name in catalogue() else name


def curve_scores(case: Judged) -> list[CurveScore]:
    """Return the score of every curve of c_d by local speed that the runs say something of."""
    curves = [curve for one in case.answer["mechanisms"] for curve in one["curves"] if one["name"] == "drag_law"]
    if case.mechanisms != {"drag_law"} or drag_factor(case.truth.psi, np.ones(1)) is None:
        return []
    scored = (_scored(case, curve) for curve in curves if curve["quantity"] == "c_d")
    return [score for score in scored if score is not None]


def _scored(case: Judged, curve: Mapping[str, Any]) -> CurveScore | None:
    x, (y, low, high) = np.array(curve["x"]["values"]), (np.array(curve["y"][k]) for k in ("values", "low", "high"))
    seen = (x >= curve["visited"][0]) & (x <= curve["visited"][1])
    factor = drag_factor(case.truth.psi, x[seen])
    if factor is None or not np.any(seen):
        return None
    truth = case.truth.theta[f"c_d.{curve['group']}"] * factor
    off = (np.sqrt(np.mean((v[seen] / truth - 1.0) ** 2)) for v in (y, np.array(curve["nominal"])))
    return CurveScore(*map(float, off), tuple(bool(i) for i in (low[seen] <= truth) & (truth <= high[seen])))


#: A case of which less is above the noise, as a share of it, counts in proportion.
_LEAST_GAIN = 0.05


def gained(case: Judged) -> tuple[float, float]:
    """Return what the extended model takes off the squared held-out error, and what there is above the noise to take.

    In units of the noise; the first is zero where nothing is named, both are where nothing is held out.
    """
    gain, floor = case.answer["gain"], case.answer["floor"]
    if gain is None or floor is None:
        return 0.0, 0.0
    before, after = (gain["held_out"][model]["pooled"] ** 2 for model in ("nominal", "extended"))
    above = max(before - floor**2, 0.0) / floor**2
    return ((before - after) / floor**2 if case.mechanisms else 0.0), above


def share_gained(cases: Sequence[Judged]) -> float:
    """Return the share of the squared held-out error above the noise that is taken off, over all cases."""
    pairs = [(taken / max(above, _LEAST_GAIN), above / max(above, _LEAST_GAIN)) for taken, above in map(gained, cases)]
    whole = sum(above for _, above in pairs)
    return sum(taken for taken, _ in pairs) / whole if whole > 0.0 else 0.0


def figures(cases: Sequence[Judged]) -> list[Figure]:
    """Return every figure of mechanisms that these cases can show."""
    told = [case for case in cases if "mechanisms" in case.answer]
    kinds = ("none", "one", "foreign", "foreign_pair", "off_list")
    of = {kind: [c for c in told if c.truth.kind == kind] for kind in kinds}
    planted = of["foreign"]
    strengths = [next(iter(case.truth.strength.values())) for case in planted]
    pairs = list(zip(planted, strengths, strict=True))
    medium = [case for case, strength in pairs if strength >= 0.9 * MEDIUM[0]]
    weak = [case for case, strength in pairs if strength < 0.9 * MEDIUM[0]]
    named = [case for kind in ("one", "foreign", "foreign_pair") for case in of[kind] if case.mechanisms]
    right = [case for case in planted if case.mechanisms and case.right_mechanisms]
    scores = [score for case in planted for score in curve_scores(case)]
    stated = [case for case in of["off_list"] if case.answer.get("domain")]
    rows = [
        _at_least("foreign: right mechanism alone", 0.95, _right(planted)),
        _at_least("of these, lambda of 90 or more", None, _right(medium)),
        _at_least("of these, lambda below 90", None, _right(weak)),
        _at_least("foreign: a set that stays is of the right mechanism", None, map(in_sets, planted)),
        _at_most("foreign, right mechanism: another formula claimed", 0.05, map(claimed, right)),
        _at_least("catalogue: right mechanism alone", None, _right(of["one"])),
        _at_least("catalogue, lambda (1 - rho) >= 16: right mechanism alone", None, _right(_clear(of["one"]))),
        _at_least("catalogue: right form alone", None, (case.right for case in of["one"])),
        _at_least("pairs, one of a foreign form: exact", 0.85, _right(of["foreign_pair"])),
        _at_most("named cases with a mechanism that is not there", 0.03, (bool(false_members(c)) for c in named)),
        _at_most("no effect: something named", 0.02, (bool(case.mechanisms) for case in of["none"])),
        _at_most("off the list: named", 0.10, (bool(case.mechanisms) for case in of["off_list"])),
        _at_most("off the list: a wrong domain stated", 0.10, (_wrong_domain(c) for c in stated), of["off_list"]),
        _median("foreign, c_d over the visited range: rms error of a curve, median", [s.error for s in scores]),
        _median("that of the nominal model there, median", [s.nominal for s in scores]),
        proportion(
            "its band contains the truth, points", "90 to 98 %", (i for s in scores for i in s.inside),
            lambda p: 0.9 <= p <= 0.98,
        ),
        Figure(
            "foreign: share of the squared held-out error above the noise that is taken off", "at least 90 %",
            share_gained(planted) if planted else float("nan"), None, len(planted),
            bool(planted) and share_gained(planted) >= 0.9,
        ),
    ]  # fmt: skip
    return [row for row in rows if row.total]


def _clear(cases: Sequence[Judged]) -> list[Judged]:
    return [case for case in cases if apart(case) >= TOLD_APART]


def _wrong_domain(case: Judged) -> bool:
    """Return whether a domain was stated of a cause off the list that does not act there."""
    return case.answer["domain"] not in OFF_DOMAINS.get(case.truth.causes[0], ())


def _at_least(what: str, share: float | None, good: Iterable[bool]) -> Figure:
    bar = "" if share is None else f"at least {share:.0%}".replace("%", " %")
    return proportion(what, bar, good, lambda p: share is None or p >= share)


def _at_most(what: str, share: float, bad: Iterable[bool], of: Sequence[Judged] = ()) -> Figure:
    """Return the share of bad ones; those of `of` that are not asked are not bad."""
    found = list(bad)
    found += [False] * (len(of) - len(found))
    return proportion(what, f"at most {share:.0%}".replace("%", " %"), found, lambda p: p <= share)


def _median(what: str, values: Sequence[float]) -> Figure:
    return Figure(what, "", float(np.median(values)) if values else float("nan"), None, len(values), True)


def _right(cases: Sequence[Judged]) -> list[bool]:
    return [case.right_mechanisms for case in cases]


def by_form(cases: Sequence[Judged]) -> list[str]:
    """Return a table of outcomes by planted form, as lines of Markdown."""
    lines = [
        "| mechanism | planted form | cases | right mechanism | formula claimed | wrong named | other verdicts |",
        "|---|---|---|---|---|---|---|",
    ]
    for mechanism, forms in BY_MECHANISM.items():
        for form in forms:
            own = [case for case in cases if case.truth.causes == (form.name,)]
            if not own:
                continue
            right = [case for case in own if case.right_mechanisms]
            silent = [str(case.answer["verdict"]) for case in own if not case.mechanisms]
            verdicts = ", ".join(f"{silent.count(v)} `{v}`" for v in dict.fromkeys(silent))
            cells = (
                mechanism, f"`{form.name}`", len(own), len(right), sum(map(claimed, right)),
                sum(bool(false_members(case)) for case in own), verdicts,
            )  # fmt: skip
            lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def line(case: Judged) -> str:
    """Return one line of a case with its truth opened."""
    (form,) = case.truth.causes
    said = "; ".join(f"{one['name']} {one['level']} {one['form']}" for one in case.answer["mechanisms"])
    sets = "" if said else "; ".join("+".join(names) for names in case.answer["alternatives"][:6])
    mark = "RIGHT" if case.right_mechanisms else "WRONG" if case.mechanisms else "-"
    claim = " CLAIMED" if claimed(case) else ""
    curves = ", ".join(f"{s.error:.1%} ({np.mean(s.inside):.0%} in)" for s in curve_scores(case))
    return (
        f"{case.truth.seed:6} {MECHANISMS[form]:16} {form:18} {case.truth.strength[form]:6.0f} {mark}{claim} "
        f"{case.answer['verdict']}: {said or sets} | gain {share_gained([case]):.0%} {curves} | "
        f"{case.truth.noise['kind']} | {case.answer['seconds']:.0f} s"
    )
