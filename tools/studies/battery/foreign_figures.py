"""Figures of mechanisms: of foreign forms, whether the mechanism was named and no formula claimed; and their curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.effects import catalogue
from studies.battery.answers import Judged
from studies.battery.figures import Figure, proportion
from studies.battery.generator.classes import CAUSES, MECHANISMS
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


def gained(case: Judged) -> float:
    """Return the share of the squared held-out error above the noise that the extended model takes off; 0 unnamed."""
    gain, floor = case.answer["gain"], case.answer["floor"]
    if not case.mechanisms or gain is None or floor is None:
        return 0.0
    before, after = (gain["held_out"][model]["pooled"] ** 2 - floor**2 for model in ("nominal", "extended"))
    return float(np.clip(1.0 - after / before, 0.0, 1.0)) if before > 0.0 else 0.0


def figures(cases: Sequence[Judged]) -> list[Figure]:
    """Return every figure of mechanisms that these cases can show; truths of one cause alone."""
    told = [case for case in cases if "mechanisms" in case.answer]
    listed = [case for case in told if case.truth.kind == "one"]
    rows = [
        proportion("catalogue: right mechanism alone", "", (c.right_mechanisms for c in listed), lambda _: True),
        proportion("catalogue: right form alone", "", (c.right for c in listed), lambda _: True),
    ]
    planted = [case for case in told if case.truth.kind == "foreign"]
    strengths = [next(iter(case.truth.strength.values())) for case in planted]
    pairs = list(zip(planted, strengths, strict=True))
    medium = [case for case, strength in pairs if strength >= 0.9 * MEDIUM[0]]
    weak = [case for case, strength in pairs if strength < 0.9 * MEDIUM[0]]
    named = [case for case in planted if case.mechanisms]
    other = [case for case in named if case.right_mechanisms]
    scores = [score for case in planted for score in curve_scores(case)]
    shares = [gained(case) for case in medium]
    rows += [
        proportion("foreign, lambda of 90 or more: right mechanism alone", "", _right(medium), lambda _: True),
        proportion("foreign, lambda below 90: right mechanism alone", "", _right(weak), lambda _: True),
        proportion("foreign: named set with a mechanism that is not there", "", map(_false, planted), lambda _: True),
        proportion("foreign: a set that stays is of the right mechanism", "", map(in_sets, planted), lambda _: True),
        proportion("foreign, right mechanism: another formula claimed", "", map(claimed, other), lambda _: True),
        _median("foreign, c_d over the visited range: rms error of a curve, median", [s.error for s in scores]),
        _median("that of the nominal model there, median", [s.nominal for s in scores]),
        proportion("its band contains the truth, points", "", (i for s in scores for i in s.inside), lambda _: True),
        Figure(
            "foreign, lambda of 90 or more: share of the held-out error above the noise that is taken off, mean",
            "",
            float(np.mean(shares)) if shares else float("nan"),
            None,
            len(shares),
            True,
        ),
    ]
    return [row for row in rows if row.total]


def _median(what: str, values: Sequence[float]) -> Figure:
    return Figure(what, "", float(np.median(values)) if values else float("nan"), None, len(values), True)


def _right(cases: Sequence[Judged]) -> list[bool]:
    return [case.right_mechanisms for case in cases]


def _false(case: Judged) -> bool:
    return bool(false_members(case))


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
                mechanism, f"`{form.name}`", len(own), len(right), sum(map(claimed, right)), sum(map(_false, own)),
                verdicts,
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
        f"{case.answer['verdict']}: {said or sets} | gain {gained(case):.0%} {curves} | "
        f"{case.truth.noise['kind']} | {case.answer['cpu']:.0f} s"
    )
