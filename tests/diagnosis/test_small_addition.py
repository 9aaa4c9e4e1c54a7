"""A second cause that is small beside the first: found where it mends all that the first leaves, and else not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mjfish.diagnosis.combinations import MENDED, Found, _borne_out, beats_smaller_sets, beside, find_combinations
from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.diagnosis.held_out import Confirmation, HeldOut
from mjfish.diagnosis.refit import converged_formula, refit_with
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.select import Goodness
from mjfish.diagnosis.table import Row
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.05])
CANDIDATES = [find(name) for name in ("time_offset", "munk_moment", "marker_offset", "servo_delay")]


def _with_offset(kappa: float, scale: float = 0.0) -> tuple[Evidence, Refit]:
    """Hide a clock offset, and beside it a Munk moment and a scale of the camera, which is no candidate."""
    pike = load_fish("pike")
    values = {"time_offset.offset": 0.02, "munk_moment.kappa": kappa, "velocity_scale.error": scale}
    effects = [find(name.partition(".")[0]) for name in values]
    dataset = generate(pike, ["v1", "v5"], values=values, effects=effects, noise=SIGMA, duration=4.0, seed=5)
    problem = Problem(Model(pike), dataset.trials, Noise.white(SIGMA))
    nominal = gather(problem, fit(problem), CANDIDATES)
    alone = refit_with(nominal, find("time_offset"))
    return nominal, converged_formula(alone, alone.fit.sse)


def _second(nominal: Evidence, alone: Refit) -> Found:
    """Return the pairs of a clock offset and a small second cause."""
    evidence, goodness = partial(beside, CANDIDATES), Goodness(CANDIDATES, HeldOut(nominal, ()))
    return find_combinations({("time_offset",): alone}, evidence, goodness, small=True)


@pytest.mark.parametrize(("kappa", "scale", "found"), [(1.0, 0.0, True), (0.0, 0.0, False), (0.0, 0.03, False)])
def test_only_what_mends_everything_is_added(kappa: float, scale: float, found: bool) -> None:
    """Nothing left, a second cause, or something else: only the second is a pair."""
    nominal, alone = _with_offset(kappa, scale)
    pairs, refits = _second(nominal, alone)
    assert (pairs is not None) is found
    if pairs is not None:
        assert [row.names for row in pairs.retained(clean=True)] == [("munk_moment", "time_offset")]
        assert refits["munk_moment", "time_offset"].gain - alone.gain > MENDED


def test_a_pair_must_explain_more_than_every_single_cause() -> None:
    """A learned form of the first that explains as much makes the second superfluous."""
    nominal, alone = _with_offset(1.0)
    singles = {("time_offset",): alone}
    _, refits = _second(nominal, alone)
    pair = refits["munk_moment", "time_offset"]
    for more, pays in ((-2.0 * MENDED, True), (0.5 * MENDED, False)):
        other = replace(alone, effects=(find("marker_offset"),), gain=pair.gain + more)
        assert beats_smaller_sets(pair, {**singles, ("marker_offset",): other}, small=True) is pays


@pytest.mark.parametrize(
    ("learned", "probability", "found"),
    [(True, 0.2, True), (True, 1e-5, False), (True, None, False), (False, 0.2, False)],
)
def test_beside_a_learned_form_something_may_be_left_if_held_out_trials_agree(
    monkeypatch: pytest.MonkeyPatch, learned: bool, probability: float | None, found: bool
) -> None:
    """The scale of the camera stands for what a learned form cannot be: a tenth of what a Munk moment leaves."""
    nominal, alone = _with_offset(1.0, 0.01)
    told = None if probability is None else Confirmation(30.0, probability)
    monkeypatch.setattr(Refit, "learned", property(lambda _refit: learned))
    monkeypatch.setattr(HeldOut, "confirmed", lambda *_: told)
    pairs, _ = _second(nominal, alone)
    assert (pairs is not None) is found
    if pairs is not None:
        assert [*pairs.rows] == [("munk_moment", "time_offset")]
        assert pairs.retained(clean=True) == []


@pytest.mark.parametrize(("excess", "borne_out"), [(150.0, True), (350.0, False)])
def test_a_small_cause_beside_a_learned_form_explains_more_than_is_left(excess: float, borne_out: bool) -> None:
    """Catches a momentum of the edge that takes up the error of form of a very soft tail, and is claimed."""
    row = Row(
        ("edge_momentum", "tail_law"), {}, (), True, 20300.0, 4, 20300.0, 0.0, 1.0, {"waves": 1e-9}, excess,
        held_out=Confirmation(50.0, 0.5),
    )  # fmt: skip
    known: Any = {("tail_law",): SimpleNamespace(gain=20000.0, learned=True)}
    assert _borne_out(row, known) is borne_out


@pytest.mark.parametrize("last_learned", [False, True])
def test_beside_a_formula_a_small_learned_form_must_mend_everything(
    monkeypatch: pytest.MonkeyPatch, last_learned: bool
) -> None:
    """Catches a learned lift that takes up what the formula of a very soft tail leaves, and is claimed."""
    nominal, alone = _with_offset(1.0, 0.01)
    monkeypatch.setattr(type(find("munk_moment")), "learned", last_learned)
    monkeypatch.setattr(Refit, "learned", property(lambda refit: len(refit.names) > 1 or not last_learned))
    monkeypatch.setattr(HeldOut, "confirmed", lambda *_: Confirmation(30.0, 0.2))
    pairs, refits = _second(nominal, alone)
    assert refits["munk_moment", "time_offset"].gain - alone.gain > MENDED
    assert (pairs is None) is last_learned


def test_a_signature_of_rounding_has_no_score() -> None:
    """Catches a family-wise p value that a cause without a derivative at its null makes a matter of rounding."""
    nominal, _ = _with_offset(0.4)
    assert not nominal.scored("servo_delay")
    assert nominal.scored("munk_moment")
    assert nominal.directed_p() < 1e-3
