"""Which forms of a mechanism stay, and at which level it is named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mjfish.diagnosis import forms as module
from mjfish.diagnosis.forms import named_mechanisms, staying


def _refit(name: str, gain: float, freedom: float = 1.0, *, learned: bool = False, limits: Any = ()) -> Any:
    effect = SimpleNamespace(name=name, mechanism="drag_law", domain="water", learned=learned, limits=limits)
    return SimpleNamespace(
        names=(name,), effects=(effect,), gain=gain, degrees_of_freedom=freedom, learned=learned,
        mechanisms=("drag_law",),
    )  # fmt: skip


LEARNED = _refit("drag_law", 120.0, 5.0, learned=True)


@pytest.mark.parametrize(("gain", "stays"), [(111.0, True), (110.0, False)])
def test_a_formula_stays_until_the_learned_form_beats_it_by_more_than_chance(gain: float, stays: bool) -> None:
    """9.49 is what four more degrees of freedom gain in 5 % of cases."""
    assert [refit.names for refit in staying([_refit("power", gain)], LEARNED)] == [("power",)] * stays


def test_every_formula_stays_where_no_form_was_learned() -> None:
    assert len(staying([_refit("power", 10.0), _refit("root", 5.0)], None)) == 2


def test_a_formula_gives_way_to_its_own_limit() -> None:
    """Of two formulas that stay, one of which is the other with a number more, that one is told."""
    wide, narrow = _refit("limited_lag", 116.0, 2.0, limits=("lag",)), _refit("lag", 115.0)
    assert [refit.names for refit in staying([wide, narrow], LEARNED)] == [("lag",)]
    assert [refit.names for refit in staying([wide, _refit("lag", 50.0)], LEARNED)] == [("limited_lag",)]


@pytest.fixture
def curves(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the refits that curves were read off."""
    seen: list[Any] = []

    def curves_of(_name: str, refit: Any, _nominal: Any) -> tuple[()]:
        seen.append(refit)
        return ()

    monkeypatch.setattr(module, "curves_of", curves_of)
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


def test_two_causes_of_one_mechanism_are_one_mechanism(curves: list[Any]) -> None:
    both = _refit("power", 118.0)
    both.effects = (*both.effects, *_refit("root", 0.0).effects)
    (found,) = named_mechanisms(both, [both], None, None, clean=True)  # type: ignore[arg-type]
    assert (found.level, found.forms) == ("mechanism", ("power", "root"))
    assert len(curves) == 1
