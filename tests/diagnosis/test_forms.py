"""Which forms of a mechanism stay, and at which level it is named."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mjfish.diagnosis import forms as module
from mjfish.diagnosis import refit as refit_module
from mjfish.diagnosis.evidence import DETECTED
from mjfish.diagnosis.forms import form_in_words, named_mechanisms, remainder_of_other_forms, simpler, staying
from mjfish.diagnosis.held_out import Confirmation, HeldOut
from mjfish.diagnosis.refit_result import Refit
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate


def _refit(name: str, gain: float, freedom: float = 1.0, *, learned: bool = False, limits: Any = ()) -> Any:
    effect = SimpleNamespace(name=name, mechanism="drag_law", domain="water", learned=learned, limits=limits)
    return SimpleNamespace(
        names=(name,), effects=(effect,), gain=gain, degrees_of_freedom=freedom, learned=learned,
        mechanisms=("drag_law",),
    )  # fmt: skip


LEARNED = _refit("drag_law", 120.0, 5.0, learned=True)


@pytest.mark.parametrize(("gain", "stays"), [(107.0, True), (106.5, False)])
def test_a_formula_stays_until_the_learned_form_beats_it_by_more_than_chance(gain: float, stays: bool) -> None:
    """13.28 is what four more degrees of freedom gain in 1 % of cases."""
    assert [refit.names for refit in staying([_refit("power", gain)], LEARNED)] == [("power",)] * stays


def test_every_formula_stays_where_no_form_was_learned() -> None:
    assert len(staying([_refit("power", 10.0), _refit("root", 5.0)], None)) == 2


def test_a_formula_gives_way_to_its_own_limit() -> None:
    """Of two formulas that stay, one of which is the other with a number more, that one is told."""
    wide, narrow = _refit("limited_lag", 116.0, 2.0, limits=("lag",)), _refit("lag", 115.0)
    assert [refit.names for refit in staying([wide, narrow], LEARNED)] == [("lag",)]
    assert [refit.names for refit in staying([wide, _refit("lag", 50.0)], LEARNED)] == [("limited_lag",)]


class _HeldOut:
    """Says by how much the log-likelihood of held-out runs, and the nRMSE, change with one refit against another."""

    def __init__(self, gained: float, error_ratio: float) -> None:
        self.found = Confirmation(gained, 0.5, error_ratio)

    def confirmed(self, refit: Any, against: Any) -> Confirmation:
        assert refit.degrees_of_freedom > against.degrees_of_freedom
        return self.found


@pytest.mark.parametrize(
    ("gained", "error_ratio", "as_well"),
    [(2.2, 0.99, True), (2.4, 0.99, False), (500.0, 1.5, True), (-1.0, 0.99, True)],
)
def test_a_formula_is_not_alone_where_a_simpler_one_predicts_held_out_runs_as_well(
    gained: float, error_ratio: float, as_well: bool
) -> None:
    """A shear of the current of −0.0016 / s was claimed where the current was the same everywhere."""
    shown, simple = _hashed(_refit("sheared", 300.0, 4.0)), _hashed(_refit("uniform", 200.0, 2.0))
    others = [simple, _hashed(_refit("other", 290.0, 5.0)), _hashed(_refit("law", 300.0, 3.0, learned=True))]
    found = simpler(shown, others, _HeldOut(gained, error_ratio))  # type: ignore[arg-type]
    assert found == ((simple,) if as_well else ())
    assert simpler(_hashed(LEARNED), others, _HeldOut(gained, error_ratio)) == ()  # type: ignore[arg-type]


def _hashed(refit: Any) -> Any:
    """Return a refit that may be a key, as real ones may."""
    return type("Refit", (), dict(vars(refit)))()


def test_without_held_out_runs_nothing_is_said_of_simpler_formulas() -> None:
    shown, simple = _hashed(_refit("sheared", 300.0, 4.0)), _hashed(_refit("uniform", 200.0, 2.0))
    assert simpler(shown, [simple], HeldOut(None, ())) == ()  # type: ignore[arg-type]


def test_what_is_said_of_a_form_fits_how_many_stay() -> None:
    """One form was told as if there were several: "its form may be"."""
    assert form_in_words(["a", "b"]) == "these data do not settle its form: a or b"
    assert form_in_words(["a"]) == ("of the known formulas a alone stays; a form that is not listed is not excluded")
    assert form_in_words(["a"], claimed=True) == "its form is a"
    assert form_in_words([]) == "no formula fits, its form is learned"


@pytest.fixture
def curves(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the refits that curves were read off."""
    seen: list[Any] = []

    def curves_of(_name: str, refit: Any, _nominal: Any) -> tuple[()]:
        seen.append(refit)
        return ()

    monkeypatch.setattr(module, "curves_of", curves_of)
    monkeypatch.setattr(module, "remainder_of_other_forms", lambda _formula, _learned: DETECTED)
    return seen


@pytest.mark.parametrize(
    ("stay", "clean", "level", "form"),
    [
        (("power",), True, "form", "power"),
        (("power",), False, "mechanism", "power"),
        (("power", "root"), True, "mechanism", "power"),
        ((), True, "mechanism", "learned"),
    ],
)
def test_the_level_is_the_deepest_that_stays(
    stay: tuple[str, ...], clean: bool, level: str, form: str, curves: list[Any]
) -> None:
    retained = [_refit(name, 118.0) for name in stay]
    best = retained[0] if retained else LEARNED
    (found,) = named_mechanisms(best, retained, LEARNED, None, clean=clean)  # type: ignore[arg-type]
    assert (found.level, found.form, found.forms) == (level, form, stay)
    assert found.domain == "water"
    assert curves == [best if level == "form" else LEARNED]


def test_a_formula_is_not_claimed_where_another_form_would_not_have_been_seen(
    curves: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "remainder_of_other_forms", lambda _formula, _learned: DETECTED - 0.1)
    power = _refit("power", 118.0)
    (found,) = named_mechanisms(power, [power], LEARNED, None, clean=True)  # type: ignore[arg-type]
    assert (found.level, found.form, found.forms) == ("mechanism", "power", ("power",))
    assert curves == [LEARNED]


@pytest.mark.slow
def test_what_other_forms_leave_grows_with_the_strength(pike: Fish) -> None:
    """A weak power of the speed may be any curve; a strong one is that power."""
    noise, left = np.array([0.004, 0.004, 0.03]), []
    for power in (0.003, 0.4):
        truth = {"power_drag.friction": power, "power_drag.pressure": power}
        data = generate(pike, ["v1", "v3-t2"], values=truth, effects=[find("power_drag")], noise=noise, duration=6.0)
        problem = Problem(Model(pike), data.trials, Noise.white(noise))
        nominal, refits = fit(problem), []
        for name in ("power_drag", "drag_law"):
            effect = find(name).for_fish(pike) or find(name)
            wide = replace(problem, model=problem.model.extended(effect))
            found = fit(wide, wide.start({**nominal.values, "power_drag.pressure": power}))
            refits.append(Refit((effect,), wide, found, nominal.sse - found.sse))
        left.append(remainder_of_other_forms(*refits) / refits[0].gain)
        assert (remainder_of_other_forms(*refits) >= DETECTED) == (power > 0.1)
    assert 0.0 < left[0] < 1.0


def test_two_causes_of_one_mechanism_are_one_mechanism(curves: list[Any]) -> None:
    both = _refit("power", 118.0)
    both.effects = (*both.effects, *_refit("root", 0.0).effects)
    (found,) = named_mechanisms(both, [both], None, None, clean=True)  # type: ignore[arg-type]
    assert (found.level, found.forms) == ("mechanism", ("power", "root"))
    assert len(curves) == 1


@pytest.mark.parametrize(
    ("pair", "coarse", "fitted", "followed"),
    [
        (None, 90.0, ["curve", "far"], ["curve", "far"]),
        (100.0, 90.0, ["curve"], ["curve"]),
        (100.0, 80.0, ["curve"], []),
    ],
)
def test_beside_two_formulas_that_leave_nothing_only_a_learned_form_near_them_is_fitted(
    monkeypatch: pytest.MonkeyPatch, pair: float | None, coarse: float, fitted: list[str], followed: list[str]
) -> None:
    """Catches minutes of learned forms that cannot explain what two formulas do."""
    scores, seen, run = {"curve": 150.0, "far": 50.0}, [], []
    learned: Any = [SimpleNamespace(name=name, mechanism=name, smooth=True) for name in scores]
    scored = SimpleNamespace(statistic=scores.__getitem__, scored=lambda _: True)

    def extended(_make: Any, effects: Any, _evidence: Any, _formulas: Any) -> list[Any]:
        seen.extend(effect.name for effect in effects)
        return [
            SimpleNamespace(names=(e.name,), mechanisms=(e.name,), gain=coarse, promise=0.0, fit=evidence.fit)
            for e in effects
        ]

    def follow(_make: Any, refits: Any) -> list[Any]:
        run.extend(refit.names[0] for refit in refits)
        return refits  # type: ignore[no-any-return]

    monkeypatch.setattr(module, "gather", lambda *_: scored)
    monkeypatch.setattr(module, "extended", extended)
    monkeypatch.setattr(refit_module, "followed", follow)
    formula: Any = SimpleNamespace(gain=60.0, mechanisms=("curve",))
    sufficient: Any = [] if pair is None else [SimpleNamespace(gain=pair)]
    evidence: Any = SimpleNamespace(problem=None, fit=SimpleNamespace(sse=200.0))
    module.refit_learned_forms(evidence, learned, [], {"law": formula}, sufficient)
    assert (seen, run) == (fitted, followed)
