"""The rule that turns numbers into a verdict."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mjfish.diagnose.select import Standing
from mjfish.diagnose.verdict import Ruling, rule

GOOD = Standing(rival_p=1.0, saturated_p=0.5, omnibus_p=0.5)
RIVAL = Standing(rival_p=0.3, saturated_p=0.5, omnibus_p=0.5)
BEATEN = Standing(rival_p=0.001, saturated_p=0.0, omnibus_p=0.0)
MISFIT = Standing(rival_p=1.0, saturated_p=1e-5, omnibus_p=0.5)


def _refit(name: str, gain: float) -> Any:
    return SimpleNamespace(effect=SimpleNamespace(name=name, summary=f"{name} acts"), gain=gain)


def _rule(standings: dict[str, Standing], held: dict[str, float | None] | None = None, p: float = 1e-6) -> Ruling:
    refits = {name: _refit(name, 100.0 - k) for k, name in enumerate(standings)}
    return rule(p, refits, standings, held or dict.fromkeys(standings, 5.0))


def test_a_model_that_is_not_contradicted_has_nothing_wrong() -> None:
    assert _rule({"a": GOOD}, p=0.02).verdict == "nothing_wrong"
    assert _rule({"a": GOOD}, p=0.0199).verdict == "named"


def test_one_cause_that_stays_is_named() -> None:
    ruling = _rule({"a": GOOD, "b": BEATEN})
    assert (ruling.verdict, ruling.names) == ("named", ("a",))


def test_several_that_stay_are_rivals() -> None:
    ruling = _rule({"a": GOOD, "b": RIVAL, "c": BEATEN})
    assert (ruling.verdict, ruling.names) == ("cannot_tell", ("a", "b"))


def test_a_best_cause_that_leaves_a_residual_is_no_explanation() -> None:
    assert _rule({"a": MISFIT, "b": BEATEN}).verdict == "unexplained"


def test_a_rival_that_fits_stands_in_for_a_best_that_does_not() -> None:
    assert _rule({"a": MISFIT, "b": RIVAL}).names == ("b",)


@pytest.mark.parametrize(("held", "verdict"), [(-0.1, "unexplained"), (0.1, "named"), (None, "named")])
def test_a_cause_must_not_lose_on_held_out_trials(held: float | None, verdict: str) -> None:
    assert _rule({"a": GOOD}, {"a": held}).verdict == verdict
