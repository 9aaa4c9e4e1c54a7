"""The figures of the battery: proportions with exact intervals ([Clopper1934]), and the bars that they are held to.

[Clopper1934] C. Clopper, E. Pearson, Biometrika 26.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import stats

from studies.battery.answers import Judged

#: Strength beyond the closest rival, lambda (1 - rho), from which a single cause must be named.
TOLD_APART = 16.0


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes:
        what: in words.
        bar: in words.
        value: proportion, or another number.
        count, total: of a proportion; None for another number.
        good: whether the bar is met.
    """

    what: str
    bar: str
    value: float
    count: int | None
    total: int
    good: bool

    @property
    def interval(self) -> tuple[float, float] | None:
        """Exact 95 % interval of a proportion."""
        if self.count is None or self.total == 0:
            return None
        ends = stats.binomtest(self.count, self.total).proportion_ci(0.95, "exact")
        return float(ends.low), float(ends.high)


def proportion(what: str, bar: str, hits: Iterable[bool], good: Callable[[float], bool]) -> Figure:
    """Return the figure of a proportion."""
    counted = list(hits)
    share = sum(counted) / len(counted) if counted else float("nan")
    return Figure(what, bar, share, sum(counted), len(counted), bool(counted) and good(share))


def apart(judged: Judged) -> float:
    """Return lambda (1 - rho) of the hardest rival of a single cause."""
    name = judged.truth.causes[0]
    return judged.truth.strength[name] * (1.0 - judged.truth.rho_max.get(name, 0.0))


def apart_squared(judged: Judged) -> float:
    """Return lambda (1 - rho^2), the part of a single cause that no rival has."""
    name = judged.truth.causes[0]
    return judged.truth.strength[name] * (1.0 - judged.truth.rho_max.get(name, 0.0) ** 2)


def in_set(judged: Judged) -> bool:
    """Return whether the truth is among the sets that stayed; `unexplained` and `nothing_wrong` keep none."""
    return any(set(names) == set(judged.truth.causes) for names in judged.answer["alternatives"])


def best_set(judged: Judged) -> tuple[str, ...]:
    """Return the set that fits best of those that stayed; none where none did."""
    return tuple(next(iter(judged.answer["alternatives"]), ()))


def figures(cases: Sequence[Judged]) -> list[Figure]:
    """Return every figure that these cases can show."""
    of = {kind: [c for c in cases if c.truth.kind == kind] for kind in ("none", "one", "two", "off_list")}
    clear = [c for c in of["one"] if apart(c) >= TOLD_APART]
    seen = [c for c in of["one"] if c.answer["verdict"] in ("named", "cannot_tell")]
    strong = [c for c in of["off_list"] if min(c.truth.strength.values(), default=0.0) >= 400.0]
    both = [c for c in of["two"] if min(c.truth.strength.values()) >= 100.0]
    rows = [
        proportion(
            "false alarms, no effect", "at most 2 %", (c.answer["verdict"] != "nothing_wrong" for c in of["none"]),
            lambda p: p <= 0.02,
        ),
        proportion(
            "right single cause, lambda (1 - rho) >= 16", "at least 98 %", (c.right for c in clear), lambda p: p >= 0.98
        ),
        proportion(
            "set contains the truth, where causes are named", "93 to 98 %", map(in_set, seen),
            lambda p: p >= 0.93,
        ),
        proportion(
            "wrong single name", "at most 3 %", (bool(c.named) and not c.right for c in of["one"]), lambda p: p <= 0.03
        ),
        proportion(
            "off-list called unexplained or cannot tell, lambda >= 400", "at least 90 %",
            (c.answer["verdict"] in ("unexplained", "cannot_tell") for c in strong), lambda p: p >= 0.9,
        ),
        proportion(
            "in-list called unexplained", "at most 2 %",
            (c.answer["verdict"] == "unexplained" for c in of["one"]), lambda p: p <= 0.02,
        ),
        proportion(
            "two effects, each lambda given the other >= 100: exact set", "at least 85 %", (c.right for c in both),
            lambda p: p >= 0.85,
        ),
        proportion("two effects: the truth is among the sets that stay", "", map(in_set, both), lambda _: True),
        proportion(
            "two effects: recall, members that are certain", "at least 95 %",
            (name in c.answer["certain"] for c in both for name in c.truth.causes),
            lambda p: p >= 0.95,
        ),
        proportion(
            "two effects: false members", "at most 7 %",
            (name not in c.truth.causes for c in both for name in c.answer["certain"]), lambda p: p <= 0.07,
        ),
        proportion(
            "two effects: recall of the set that fits best, whoever ties with it", "",
            (name in best_set(c) for c in both for name in c.truth.causes), lambda _: True,
        ),
        *sizes(of["one"]),
        proportion(
            "coefficients: true value inside the 95 % interval, where the verdict is right", "90 to 98 %",
            coefficients([*of["none"], *of["one"]]), lambda p: 0.9 <= p <= 0.98,
        ),
        *gains(clear),
    ]  # fmt: skip
    return [row for row in rows if row.total]


def coefficients(cases: Sequence[Judged]) -> list[bool]:
    """Return whether the interval of each coefficient holds the truth, of cases that are judged right."""
    found = []
    for case in cases:
        if case.named != frozenset(case.truth.causes) or case.answer["verdict"] not in ("nothing_wrong", "named"):
            continue
        for name, truth in case.truth.theta.items():
            own = case.answer.get("coefficients", {}).get(name)
            if own is not None and not own["at_bound"]:
                found.append(bool(own["low"] <= truth <= own["high"]))
    return found


def sizes(cases: Sequence[Judged]) -> list[Figure]:
    """Return how well sizes come out, of named causes whose definition solver and generator share."""
    errors, inside = [], []
    for case in cases:
        name = case.truth.causes[0]
        if not case.right or not case.truth.exact[name] or case.truth.strength[name] < 120.0:
            continue
        for short, value in case.answer["causes"][name].items():
            truth = case.truth.psi.get(f"{name}.{short}")
            if truth is None or value["at_bound"]:
                continue
            inside.append(value["low"] <= truth <= value["high"])
            if truth:
                errors.append(abs(value["estimate"] / truth - 1.0))
    median = float(np.median(errors)) if errors else float("nan")
    return [
        Figure(
            "size of the named cause, lambda >= 120: median error",
            "at most 6 %",
            median,
            None,
            len(errors),
            median <= 0.06,
        ),
        proportion("its 95 % intervals contain the truth", "90 to 98 %", inside, lambda p: 0.9 <= p <= 0.985),
    ]


def gains(cases: Sequence[Judged]) -> list[Figure]:
    """Return what naming gains on held-out trials, as a share of what the true cause refitted gains there.

    Of falls of the squared error; nothing where no cause is named or the true one was not refitted, at most all of it.
    Cases where the true cause does not help on the held-out trials are left out.
    """
    shares = []
    for case in cases:
        gained = case.answer["gain"]
        if not case.named or gained is None:
            shares.append(0.0)
            continue
        nominal, reached = (gained["held_out"][model]["pooled"] for model in ("nominal", "extended"))
        refitted = {one["name"]: one["held_out_error"] for one in case.answer["candidates"]}
        truth = refitted.get(case.truth.causes[0])
        if truth is None:
            shares.append(0.0)
        elif truth < nominal:
            shares.append(float(np.clip((nominal**2 - reached**2) / (nominal**2 - truth**2), 0.0, 1.0)))
    share = float(np.mean(shares)) if shares else float("nan")
    what = "held-out gain over that of the true cause refitted, lambda (1 - rho) >= 16: mean"
    return [Figure(what, "at least 80 %", share, None, len(shares), share >= 0.8)]


def strata(cases: Sequence[Judged]) -> list[Figure]:
    """Return right names by strength, and false alarms by kind of noise."""
    rows = []
    edges = [0.0, 8.0, 16.0, 40.0, 120.0, 400.0, np.inf]
    singles = [c for c in cases if c.truth.kind == "one"]
    for low, high in pairwise(edges):
        here = [c for c in singles if low <= apart(c) < high]
        rows.append(
            proportion(f"right, lambda (1 - rho) {low:g} to {high:g}", "", (c.right for c in here), lambda _: True)
        )
    for kind in sorted({str(c.truth.noise["kind"]) for c in cases}):
        here = [c for c in cases if c.truth.kind == "none" and c.truth.noise["kind"] == kind]
        alarms = (c.answer["verdict"] != "nothing_wrong" for c in here)
        rows.append(proportion(f"false alarms, {kind} noise", "at most 8 %", alarms, lambda p: p <= 0.08))
    return [row for row in rows if row.total]
