"""Several causes at once: what a further one must earn, and what it may stand in for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mjfish.diagnosis import combinations as module
from mjfish.diagnosis import refit as refit_module
from mjfish.diagnosis.combinations import beats_smaller_sets, find_combinations
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.refit import refit_with
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.select import Goodness
from mjfish.diagnosis.table import Comparison, Row
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

Names = tuple[str, ...]
SIGMA = np.array([0.006, 0.006, 0.05])
UNTESTED = Goodness((), HeldOut(None, ()))  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Set:
    """A set of causes and what it explains, of a table."""

    names: Names
    gain: float = 0.0
    degrees_of_freedom: int = 1
    gains: Any = field(default=None, hash=False)
    learned: bool = False
    promise: float = 0.0
    fit: Any = field(default_factory=lambda: SimpleNamespace(sse=1.0, count=1), hash=False, compare=False)

    @property
    def effects(self) -> list[Any]:
        return [SimpleNamespace(name=name, limits=()) for name in self.names]

    @property
    def mechanisms(self) -> Names:
        return self.names

    @property
    def reach(self) -> float:
        return self.gain + 2.0 * self.promise

    @property
    def adjusted(self) -> float:
        return self.gain - 2.0 * (self.degrees_of_freedom - 1)

    def less(self, out: Any) -> _Set:
        names = tuple(name for name in self.names if name != out.name)
        return replace(self, names=names, gain=self.gains[names])

    def row(self, behind: float, p: float, left: float) -> Row:
        """Return the row of the best set, or of one that it beats; p of what it leaves, and which share."""
        tests, excess = ({"waves": p}, left / (1.0 - left) * self.gain) if behind == 0.0 else ({}, np.inf)
        best = float(behind == 0.0)
        return Row(self.names, {}, (), self.learned, self.gain, 1, self.adjusted, behind, best, tests, excess)


@pytest.mark.parametrize(("gain", "freedom", "stays"), [(124.0, 2, True), (124.0, 5, False), (133.0, 5, True)])
def test_a_further_cause_of_many_parameters_must_explain_more(gain: float, freedom: int, stays: bool) -> None:
    """The cause alone explains 100."""
    known = {("lag",): _Set(("lag",), 100.0, 1)}
    assert beats_smaller_sets(_Set(("lag", "other"), gain, freedom), known) is stays  # type: ignore[arg-type]


def test_a_smaller_set_counts_with_what_its_next_step_promises() -> None:
    """Catches a member that is only there because the set without it was not fitted to its optimum."""
    pair: Any = _Set(("lag", "other"), 140.0)
    assert beats_smaller_sets(pair, {("lag",): _Set(("lag",), 100.0)})  # type: ignore[dict-item]
    assert not beats_smaller_sets(pair, {("lag",): _Set(("lag",), 100.0, promise=30.0)})  # type: ignore[dict-item]


#: Drag stands in for the wake until the wake is added; alone, the stiffness shows little and is not refitted.
GAINS = {
    ("drag",): 425.0,
    ("wake",): 381.0,
    ("drag", "stiff"): 489.0,
    ("drag", "wake"): 456.0,
    ("stiff", "wake"): 593.0,
    ("drag", "stiff", "wake"): 594.0,
}


def _all_else(base: Any) -> Any:
    """Return evidence by which all that the best set explains beyond a base is seen beside it."""
    return SimpleNamespace(saturated_excess=lambda: GAINS["drag", "stiff", "wake"] - base.gain)


@pytest.mark.parametrize(("pair", "named"), [(593.0, ("stiff", "wake")), (540.0, ("drag", "stiff", "wake"))])
def test_a_member_that_a_later_one_makes_redundant_is_dropped(
    monkeypatch: pytest.MonkeyPatch, pair: float, named: Names
) -> None:
    """Catches a set that keeps a superfluous member since nobody came by the set without it."""
    gains = {**GAINS, ("stiff", "wake"): pair}
    came_by = {2: [("drag", "stiff")], 3: [("drag", "stiff", "wake")]}

    def extended(bases: Any, _evidence: Any, _known: Any, _whole: float, shortlist: Any) -> dict[Names, _Set]:
        size = len(bases[0].names) + 1
        found = [] if shortlist is module._unscored_additions else came_by[size]
        return {names: _Set(names, gains[names], gains=gains) for names in found}

    def compared(sets: dict[Names, _Set], *_: Any) -> Comparison:
        top = max(one.gain for one in sets.values())
        rows = {names: one.row(top - one.gain, float(one.gain > 530.0), 0.18) for names, one in sets.items()}
        return Comparison(rows)

    monkeypatch.setattr(module, "_extended", extended)
    monkeypatch.setattr(module, "followed", lambda make, refits, _names=None: map(make, refits))
    monkeypatch.setattr(module, "compared", compared)
    singles: Any = {(name,): _Set((name,), gains[(name,)], gains=gains) for name in ("drag", "wake")}
    found, _ = find_combinations(singles, _all_else, UNTESTED)
    assert found is not None
    assert [row.names for row in found.retained(clean=True)] == [named]


def test_a_general_form_gives_way_to_the_formula_that_it_becomes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Catches a current that is named with a shear of zero, since the lag was added to the sheared one alone."""
    effects = [SimpleNamespace(name="lag", limits=()), SimpleNamespace(name="shear", limits=("current",))]
    general: Any = SimpleNamespace(names=("lag", "shear"), effects=effects)
    asked = []

    def extended(bases: Any, _evidence: Any, _known: Any, _whole: float, shortlist: Any) -> dict[Names, _Set]:
        after = SimpleNamespace(candidates=[SimpleNamespace(name="current"), SimpleNamespace(name="drag")])
        asked.append(([base.names for base in bases], [effect.name for effect in shortlist(after)]))
        return {("current", "lag"): _Set(("current", "lag"))}

    monkeypatch.setattr(module, "_extended", extended)
    rest: Any = {("lag",): _Set(("lag",))}
    evidence: Any = None
    assert [*module._narrower([general], evidence, rest, 1.0)] == [("current", "lag")]
    assert asked == [([("lag",)], ["current"])]
    assert module._narrower([general], evidence, {}, 1.0) == {}


def test_no_third_cause_is_looked_for_where_the_best_pair_leaves_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pair that explains little is none, and three that hold it would be none either."""
    sizes = []

    def extended(bases: Any, _evidence: Any, _known: Any, _whole: float, _shortlist: Any) -> dict[Names, _Set]:
        sizes.append(len(bases[0].names) + 1)
        return {("drag", "stiff"): _Set(("drag", "stiff"), 489.0, gains=GAINS)}

    monkeypatch.setattr(module, "_extended", extended)
    monkeypatch.setattr(
        module, "compared", lambda sets, *_: Comparison({n: one.row(0.0, 0.0, 0.35) for n, one in sets.items()})
    )
    singles: Any = {("drag",): _Set(("drag",), 425.0, gains=GAINS)}
    found, _ = find_combinations(singles, _all_else, UNTESTED)
    assert found is not None
    assert set(sizes) == {2}


def test_a_set_that_is_far_off_is_refitted_from_the_best_of_its_mechanisms() -> None:
    """From a servo lag of next to nothing, and coefficients that make up for it, the fit ends in another minimum."""
    lag, scale = find("servo_lag"), find("velocity_scale")
    values = {"servo_lag.time_constant": 0.03, "velocity_scale.error": 0.1}
    dataset = generate(
        load_fish("pike"), ["v1", "v5"], values=values, effects=[lag, scale], noise=SIGMA, duration=4.0, seed=3
    )
    problem = Problem(Model(load_fish("pike"), (lag, scale)), dataset.trials, Noise.white(SIGMA))
    best = Refit((lag, scale), problem, fit(problem, problem.start(values)), 1000.0)
    bent = problem.start({"servo_lag.time_constant": 0.0, "c_m.body": 3.0, "c_d.tail": 0.1})
    lost = Refit((lag, scale), problem, fit(problem, bent, evaluations=1), 100.0)
    found = module._from_the_best(best, lost)
    assert found.fit.sse == pytest.approx(best.fit.sse, rel=1e-4)
    assert found.gain == pytest.approx(100.0 + lost.fit.sse - best.fit.sse, rel=1e-3)
    assert module._from_the_best(lost, best) is best


def test_a_set_without_a_member_has_the_fit_that_never_had_it() -> None:
    lag, scale = find("servo_lag"), find("velocity_scale")
    pike = load_fish("pike")
    values = {"servo_lag.time_constant": 0.03, "velocity_scale.error": 0.1}
    dataset = generate(pike, ["v1", "v5"], values=values, effects=[lag, scale], noise=SIGMA, duration=4.0, seed=3)
    problem = Problem(Model(pike), dataset.trials, Noise.white(SIGMA))
    nominal = gather(problem, fit(problem), [lag, scale])
    alone = refit_with(nominal, lag)
    both = refit_with(gather(alone.problem, alone.fit, [scale]), scale, gained=alone.gain)
    for out, left in ((scale, "servo_lag"), (lag, "velocity_scale")):
        less = both.less(out)
        assert less.names == (left,)
        direct = fit(replace(problem, model=Model(pike, less.effects)), tolerance=1e-7)
        assert less.fit.sse == pytest.approx(direct.sse, rel=1e-4)
        assert less.gain == pytest.approx(nominal.fit.sse - less.fit.sse)
        assert less.degrees_of_freedom == 1


def test_formulas_of_one_mechanism_are_extended_once() -> None:
    sets: Any = {name: _Set((name,), gain) for name, gain in (("a", 9.0), ("b", 8.0), ("c", 7.0), ("curve", 6.0))}
    alike = replace(sets["b"], names=("a",), gain=8.5)
    sets["curve"] = replace(sets["curve"], learned=True)
    assert module._best([*sets.values(), alike]) == [sets["a"], sets["b"], sets["curve"]]


def _scored(scores: dict[str, float], excess: float, causes: int = 1) -> Any:
    """Return the evidence of candidates with these scores beside so many causes, of all that they explain together."""
    return SimpleNamespace(
        problem=SimpleNamespace(causes=("cause",) * causes),
        candidates=[SimpleNamespace(name=name, learned=name.isupper(), limits=()) for name in scores],
        unidentifiable=lambda _: False,
        scored=lambda _: True,
        directed_p=lambda: 0.0,
        saturated_excess=lambda: excess,
        statistic=scores.__getitem__,
        worth=scores.__getitem__,
    )


@pytest.mark.parametrize(
    ("scores", "added"),
    [
        ({"a": 90.0, "b": 60.0, "c": 40.0}, ["a", "b"]),
        ({"a": 30.0, "b": 20.0, "c": 10.0}, ["a"]),  # the best one always
        ({"a": 90.0, "b": 80.0, "c": 70.0, "d": 60.0}, ["a", "b", "c"]),
    ],
)
def test_additions_explain_half_of_what_is_left(scores: dict[str, float], added: list[str]) -> None:
    assert [effect.name for effect in module._visible_additions(_scored(scores, 100.0), learned=True)] == added


def test_formulas_are_added_before_learned_forms() -> None:
    """A learned form with a larger score takes no place from a formula."""
    scores = {"CURVE": 95.0, "LAW": 93.0, "a": 90.0, "b": 80.0, "c": 70.0}
    for learned, added in ((False, ["a", "b", "c"]), (True, ["CURVE", "LAW", "a"])):
        assert [e.name for e in module._visible_additions(_scored(scores, 100.0), learned=learned)] == added


@pytest.mark.parametrize(("fit_p", "asked"), [(1.0, [False]), (0.0, [False, True])])
def test_no_learned_form_is_asked_for_where_two_formulas_leave_nothing(
    monkeypatch: pytest.MonkeyPatch, fit_p: float, asked: list[bool]
) -> None:
    seen, gains = [], {**GAINS, ("drag", "wake"): 593.0}

    def extended(_bases: Any, _evidence: Any, _known: Any, _whole: float, shortlist: Any) -> dict[Names, _Set]:
        if shortlist is module._unscored_additions:
            return {}
        seen.append(shortlist.keywords["learned"])
        return {("drag", "wake"): _Set(("drag", "wake"), 593.0, gains=gains)}

    monkeypatch.setattr(module, "_extended", extended)
    monkeypatch.setattr(module, "followed", lambda make, refits, _names=None: map(make, refits))
    monkeypatch.setattr(
        module, "compared", lambda sets, *_: Comparison({n: one.row(0.0, fit_p, 0.5) for n, one in sets.items()})
    )
    singles: Any = {(name,): _Set((name,), gains[(name,)], gains=gains) for name in ("drag", "wake")}
    find_combinations(singles, _all_else, UNTESTED)
    assert [*dict.fromkeys(seen)] == asked


def test_an_addition_that_cannot_earn_its_place_is_not_refitted() -> None:
    """But for the best second cause, whose score may be small because it is large."""
    small = {"a": 19.0, "b": 18.0}
    assert [effect.name for effect in module._visible_additions(_scored(small, 20.0), learned=True)] == ["a"]
    assert module._visible_additions(_scored(small, 20.0, causes=2), learned=True) == []


@pytest.mark.parametrize(("whole", "expected"), [(750.0, ["near"]), (1200.0, [])])
def test_what_cannot_be_like_the_truth_is_not_followed(
    monkeypatch: pytest.MonkeyPatch, whole: float, expected: list[str]
) -> None:
    """Catches a pair that leaves most, or is far behind another pair, and is fitted to its optimum all the same."""
    gains, followed = {"near": 600.0, "far": 450.0}, []

    def made(_make: Any, new: Any, _after: Any, _given: Any) -> list[_Set]:
        return [_Set(("base", effect.name), gains[effect.name]) for effect in new]

    def follow(_make: Any, refits: Any) -> list[Any]:
        followed.extend(refit.names[-1] for refit in refits)
        return []

    monkeypatch.setattr(module, "extended", made)
    monkeypatch.setattr(refit_module, "followed", follow)
    base: Any = _Set(("base",), 400.0)
    beside = _scored({"near": 1.0, "far": 1.0}, 1.0)
    module._extended([base], lambda _: beside, {}, whole, lambda after: after.candidates)
    assert followed == expected


def test_a_general_form_is_added_after_the_formulas_that_it_begins_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Catches a lag of limited speed that is refitted from nowhere: it explained less than nothing."""
    made = []

    def extended(_make: Any, new: Any, _after: Any, given: Any) -> list[_Set]:
        made.extend((effect.name, [one.names for one in own]) for effect, own in zip(new, given, strict=True))
        return [_Set(("base", effect.name), 500.0) for effect in new]

    beside = _scored({"both": 9.0, "lag": 0.0, "limit": 0.0}, 1.0)
    beside.candidates[0].limits = ("lag", "limit")
    monkeypatch.setattr(module, "extended", extended)
    monkeypatch.setattr(refit_module, "followed", lambda *_: [])
    base: Any = _Set(("base",), 400.0)
    module._extended([base], lambda _: beside, {}, 750.0, lambda after: after.candidates[:1])
    assert made == [("lag", []), ("limit", []), ("both", [("base", "lag"), ("base", "limit")])]


def test_a_set_has_one_learned_form_at_most() -> None:
    pike = load_fish("pike")
    pool = generate(pike, ["v1", "v3"], noise=SIGMA, duration=3.0)
    problem = Problem(Model(pike), pool.trials, Noise.white(SIGMA))
    nominal = fit(problem)
    lift, drag, linear = find("lift"), find("drag_law"), find("linear_drag")
    learned = refit_with(gather(problem, nominal, [lift]), lift)
    plain = refit_with(gather(problem, nominal, [linear]), linear)
    candidates = [lift, drag, linear]
    assert [effect.name for effect in module.beside(candidates, learned).candidates] == ["linear_drag"]
    assert [effect.name for effect in module.beside(candidates, plain).candidates] == ["lift"]
