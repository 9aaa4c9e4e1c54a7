"""Settings of a fit: patterns, and what they refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import as_measured, swimming

from mjfish.errors import InputError, MjfishError, ParameterError, UnknownNameError
from mjfish.estimation.identification import pose
from mjfish.estimation.settings import PAPER_SIGMA, Settings
from mjfish.fish import Fish


def test_patterns_say_what_is_free_fixed_and_bounded(pike: Fish) -> None:
    fixed, declared = Settings(
        free=("c_*.head", "c_d.*"), fixed={"c_m.head": None, "c_d.tail": 1.25}, bounds={"c_d.b*": (0.5, None)},
        start={"c_f.head": 0.015},
    ).choose(pike.parameters)  # fmt: skip
    assert set(COEFFICIENTS) - set(fixed) == {"c_f.head", "c_d.head", "c_d.body"}
    assert (fixed["c_m.head"], fixed["c_d.tail"], fixed["c_f.body"]) == (0.01, 1.25, 0.02)
    assert (declared["c_d.body"].low, declared["c_d.body"].high, declared["c_d.body"].start) == (0.5, 4.0, 2.0)
    assert (declared["c_f.head"].start, declared["c_f.head"].high) == (0.015, 0.02)


def test_new_bounds_move_a_declared_start_inside_but_never_a_given_one(pike: Fish) -> None:
    _, declared = Settings(bounds={"c_d.head": (2.5, 3.5)}).choose(pike.parameters)
    assert declared["c_d.head"].start == 2.5
    with pytest.raises(ParameterError, match=r"c_d.head: start 2 - is outside its bounds \[2.5, 3.5\]; choose"):
        Settings(bounds={"c_d.head": (2.5, 3.5)}, start={"c_d.head": 2.0}).choose(pike.parameters)


@pytest.mark.parametrize(
    ("settings", "error", "complaint"),
    [
        ({"free": ("c_x.*",)}, UnknownNameError, "unknown parameter of free 'c_x.*'; known: c_d.body"),
        ({"fixed": {"c_d": 1.0}}, UnknownNameError, "unknown parameter of fix 'c_d'"),
        (
            {"fixed": {"c_d.*": 1.0, "*.head": 0.02}},
            InputError,
            "'c_d.*' and '*.head' say different things of c_d.head",
        ),
        ({"fixed": {"c_d.head": 1.0}, "start": {"c_d.*": 1.0}}, InputError, "c_d.head is fixed, and given a start"),
        ({"fixed": {"*": None}}, InputError, "every parameter is fixed; leave one free"),
        ({"fixed": {"c_d.head": 9.0}}, ParameterError, "c_d.head: fixed value 9 - is outside its bounds"),
        ({"bounds": {"c_d.head": (3.0, 2.0)}}, ParameterError, "low must be below high"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    pike: Fish, settings: dict[str, object], error: type[MjfishError], complaint: str
) -> None:
    with pytest.raises(error) as caught:
        Settings(**settings).choose(pike.parameters)  # type: ignore[arg-type]
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"loss": "square"}, "unknown loss 'square'; known: arctan, cauchy, huber, linear, soft_l1"),
        ({"weights": "mine"}, "unknown weights 'mine'"),
        ({"starts": 0}, "starts is 0, expected 1 to 1000000"),
        ({"loss_scale": 0.0}, "loss_scale is 0, expected a positive number"),
    ],
)
def test_names_and_numbers_of_settings_are_checked(settings: dict[str, object], complaint: str) -> None:
    with pytest.raises(MjfishError, match=complaint):
        Settings(**settings)  # type: ignore[arg-type]


def test_the_papers_weights_are_those_of_its_matrix() -> None:
    """W = diag(1e4, 1e4, (180/pi)^2): centimetres and degrees."""
    sigma = Settings(weights="paper").sigma(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(1.0 / sigma**2, [1e4, 1e4, (180.0 / np.pi) ** 2])
    np.testing.assert_array_equal(Settings().sigma(np.array([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0])
    assert PAPER_SIGMA[0] == 0.01


def test_what_belongs_to_a_trial_can_be_fixed_too(pike: Fish) -> None:
    """A start velocity at its first sample, a clock that is known; the other trial keeps its own."""
    dataset = swimming(pike, ("v1", "v3"))
    trials = tuple(replace(as_measured(trial, pike), role="fit") for trial in dataset.trials)
    measured = replace(dataset, trials=trials, clock="free")
    settings = Settings(fixed={"v1:start.*": None, "v1:clock.offset": 0.02, "c_*": None}, starts=1)
    posed = pose(measured, settings)
    assert [p.name for p in posed.parameters] == [
        "v3:start.surge", "v3:start.sway", "v3:start.yaw_rate", "v3:clock.offset",
    ]  # fmt: skip
    assert posed.fixed["v1:start.surge"] == trials[0].velocity[0, 0]
    held = replace(posed, trials=trials[:1], fixed={**posed.fixed, "v1:clock.offset": 0.0})
    here = replace(held, fixed=posed.fixed)
    assert not np.array_equal(held.predictions(np.zeros(0))[0], here.predictions(np.zeros(0))[0])
