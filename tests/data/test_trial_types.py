"""Which trials are held out; what a dataset shows of itself, and how a trial is found in it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjfish.data import Dataset, Role, Sensor, Trial
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish


def dataset(fish: Fish, roles: list[Role | None]) -> Dataset:
    empty = np.zeros(0), np.zeros((0, 3))
    return Dataset("d", fish, tuple(Trial(str(number), role, *empty) for number, role in enumerate(roles)))


@pytest.mark.parametrize(
    ("count", "held"),
    [(1, []), (2, [1]), (3, [1]), (4, [1]), (5, [1, 4]), (6, [1, 4]), (8, [1, 4, 7]), (10, [1, 4, 7])],
)
def test_without_roles_a_third_is_held_out(count: int, held: list[int], pike: Fish) -> None:
    fit, out = dataset(pike, [None] * count).split()
    assert [trial.name for trial in out] == [str(number) for number in held]
    assert [trial.name for trial in fit] == [str(number) for number in range(count) if number not in held]


def test_with_roles_trials_without_one_are_fitted(pike: Fish) -> None:
    fit, out = dataset(pike, [None, "held_out", "fit", "held_out", None]).split()
    assert [trial.name for trial in fit] == ["0", "2", "4"]
    assert [trial.name for trial in out] == ["1", "3"]


def test_a_role_of_fit_alone_holds_nothing_out(pike: Fish) -> None:
    fit, out = dataset(pike, [None, "fit", None]).split()
    assert [trial.name for trial in fit] == ["0", "1", "2"]
    assert out == ()


def test_a_dataset_prints_at_most_ten_lines_and_no_arrays(pike: Fish) -> None:
    time = np.linspace(0.0, 5.0, 101)
    trials = tuple(Trial(f"t{number}", "fit", time, np.zeros((101, 3))) for number in range(12))
    lines = repr(Dataset("pool", pike, trials, noise=np.array([0.01, 0.02, 0.3]))).splitlines()
    assert len(lines) == 10
    assert lines[0] == "<Dataset 'pool': fish 'pike', 12 trials, clock synchronised"
    assert lines[1] == "  noise: surge 0.01 m/s, sway 0.02 m/s, yaw rate 0.3 rad/s"
    assert lines[2] == "  <Trial 't0', role fit: 101 samples in 5 s (20 Hz), driven by measured joint angles>"
    assert lines[-1] == "  and 5 more trials>"


def _pool(pike: Fish, *names: str, trial: Trial | None = None) -> Dataset:
    time = np.linspace(0.0, 5.0, 101)
    blank = trial or Trial("", None, time, np.ones((101, 3)))
    return Dataset("pool", pike, tuple(replace(blank, name=name) for name in names))


def test_a_trial_is_found_by_its_name(pike: Fish) -> None:
    pool = _pool(pike, "left", "right")
    assert pool["right"] is pool.trials[1]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lefft", r"^unknown trial 'lefft'; known: left, right; did you mean left\?$"),
        ("up", "^unknown trial 'up'; known: left, right$"),
        (0, "^unknown trial '0'; known: left, right$"),
    ],
)
def test_an_unknown_trial_is_refused_with_those_that_are_similar(pike: Fish, name: Any, said: str) -> None:
    with pytest.raises(UnknownNameError, match=said):
        _pool(pike, "left", "right")[name]


def test_the_summary_of_a_dataset_is_its_text_without_brackets(pike: Fish) -> None:
    pool = _pool(pike, *map(str, range(12)))
    assert repr(pool) == f"<{pool.summary()}>"
    assert len(pool.summary().splitlines()) == 10
    assert pool.summary().startswith("Dataset 'pool': fish 'pike', 12 trials")


def test_a_dataset_draws_every_velocity_of_every_trial(pike: Fish) -> None:
    """Names are escaped: plotly takes them for markup."""
    drawn = _pool(pike, "left", "<b>").plot()
    curves = [(trace.name, trace.xaxis, trace.y[0]) for trace in drawn.data]
    assert curves == [(name, axis, 1.0) for axis in ("x", "x2", "x3") for name in ("left", "&lt;b&gt;")]
    assert drawn.layout.title.text is None


def test_places_and_headings_are_drawn_as_velocities_of_the_smoothed_path(pike: Fish) -> None:
    time = np.linspace(0.0, 5.0, 101)
    seen = (
        Sensor("position", "position", time, np.stack([0.3 * time, 0.0 * time], axis=1)),
        Sensor("heading", "heading", time, np.zeros((101, 1))),
    )
    drawn = _pool(pike, "left", trial=Trial("", None, time, np.full((101, 3), np.nan), sensors=seen)).plot()
    np.testing.assert_allclose(drawn.data[0].y, 0.3, rtol=1e-6)
    assert "smoothed path" in drawn.layout.title.text


def test_a_dataset_of_something_else_is_refused(pike: Fish) -> None:
    with pytest.raises(InputError, match=r"^Dataset: fish: found 'pike' \(str\), expected Fish; correct it$"):
        Dataset("pool", "pike", ())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Dataset: trials: found "):
        Dataset("pool", pike, ("left",))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("velocity", "said"),
    [
        (
            np.zeros((50, 3)),
            r"^trial 't': surge, sway, yaw_rate have shape \(50, 3\), expected \(101, 3\)",
        ),
        (np.zeros((101, 2)), r"have shape \(101, 2\), expected \(101, 3\)"),
        ([[0.0, 0.0, 0.0]] * 101, r"^trial 't': velocity: found .* \(list\), expected ndarray"),
    ],
)
def test_velocities_that_are_not_three_for_every_time_are_refused(pike: Fish, velocity: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Dataset("pool", pike, (Trial("t", "fit", np.linspace(0.0, 5.0, 101), velocity),))
