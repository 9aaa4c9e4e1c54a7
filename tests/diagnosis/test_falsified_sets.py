"""Sets that fail on the held-out trials are out, however well they fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from mjfish.diagnosis import compared as module
from mjfish.diagnosis.held_out import Confirmation
from mjfish.diagnosis.table import Comparison, Row

STAYS = Row((), {}, (), False, 100.0, 1, 100.0, 0.0, 1.0, {"waves": 0.5}, 0.0)


def test_a_cause_that_makes_the_held_out_error_larger_fails_whatever_its_likelihood() -> None:
    """An uncertain prediction may gain likelihood and be far off."""
    assert not Confirmation(50.0, 0.5).failed()
    assert not Confirmation(50.0, 0.5, 1.05).failed()
    assert Confirmation(50.0, 0.5, 1.2).failed()


def test_a_larger_held_out_error_within_noise_is_chance() -> None:
    """Errors of commanded joints carry a path away, with the right cause as well as without it."""
    assert not Confirmation(50.0, 0.5, 1.2, 1.1).failed()
    assert Confirmation(50.0, 0.5, 1.2, 1.4).failed()
    assert Confirmation(-5.0, 1e-4, 1.2, 1.1).failed()


def test_a_set_fails_whose_mean_speed_is_ten_times_further_off() -> None:
    """Catches a set that is a gain by nRMSE, and swims at another speed; within noise that is chance."""
    assert not Confirmation(50.0, 0.5, 0.9, 1.4, 9.0).failed()
    assert Confirmation(50.0, 0.5, 0.9, 1.4, 11.0).failed()
    assert not Confirmation(50.0, 0.5, 0.9, 1.1, 11.0).failed()


def _found(names: tuple[str, ...], ratio: float) -> tuple[Comparison, dict[Any, Any]]:
    row = replace(STAYS, names=names, learned="lift" in names, held_out=Confirmation(10.0, 0.5, ratio))
    return Comparison({names: row}), {names: SimpleNamespace(learned="lift" in names)}


@pytest.mark.parametrize(("ratio", "expected"), [(3.0, ("roll", "current")), (0.8, ("roll", "lift"))])
def test_formulas_are_compared_where_all_learned_sets_fail(
    monkeypatch: pytest.MonkeyPatch, ratio: float, expected: tuple[str, ...]
) -> None:
    """A set with a learned member that predicts badly makes room for one of formulas; one that holds stays."""

    def find(
        refits: Any, _evidence: Any, _goodness: Any, *, small: bool, formulas: bool = False
    ) -> tuple[Comparison, dict[Any, Any]]:
        assert not small
        assert formulas == (not any(refit.learned for refit in refits.values()))
        return _found(("roll", "current"), 0.9) if formulas else _found(("roll", "lift"), ratio)

    monkeypatch.setattr(module, "find_combinations", find)
    refits: Any = {(name,): SimpleNamespace(learned=name == "lift") for name in ("roll", "lift")}
    single: Any = SimpleNamespace(exhausted=lambda: False)
    nothing: Any = None
    found, refits = module._combined(single, refits, nothing, nothing)
    assert found is not None
    assert [row.names for row in found.retained(clean=False)] == [expected]
    assert [*refits] == [("roll", "lift"), *([expected] if ratio > 1.0 else [])]
