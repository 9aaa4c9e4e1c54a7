"""A finding that blocks proposes a correction of the data, and the likelihood says whether it is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bad_data import SIGMA, good, rows, spoiled, velocity

from mjfish.data import Dataset, Trial
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.compared import weighed
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.inspection import Finding, inspect, inspect_fit
from mjfish.model import Model
from mjfish.numerics.arrays import readonly


def _swapped() -> Dataset:
    drives = {"v1": "v5", "v5": "v1"}
    own = {trial.name: trial.drive for trial in good().trials}
    return spoiled(lambda trial: replace(trial, drive=own[drives.get(trial.name, trial.name)]))


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda: spoiled(velocity(lambda v: v * [1, 1, -1])), "signs-channel"),
        (lambda: spoiled(velocity(lambda v: v[:, [1, 0, 2]])), "signs-channel"),
        (lambda: spoiled(velocity(lambda v: v * [1, -1, 1]), "v5"), "signs-channel"),
        (lambda: spoiled(velocity(lambda v: v * [1, 1, 180 / np.pi])), "signs-unit"),
        (lambda: spoiled(velocity(lambda v: v * [1000, 1, 1]), "v5"), "signs-unit"),
        (_swapped, "labels-swapped"),
    ],
)
def test_the_right_correction_explains_all(spoil: Callable[[], Dataset], code: str) -> None:
    """In the same numbers, whatever their unit: nothing is left but noise."""
    dataset = spoil()
    refuted, corrections = weighed(inspect(dataset).blocks, dataset)
    assert not refuted
    (row,) = corrections
    assert row.names[0].startswith(code)
    assert row.gain > 1e4
    assert row.remaining < 1e-3
    assert row.clean()


def test_lost_frames_are_put_back() -> None:
    dataset = spoiled(rows(lambda trial: np.delete(np.arange(len(trial.time)), np.s_[180:185])), "v3")

    def closed(trial: Trial) -> Trial:
        even = trial.time[0] + trial.step * np.arange(len(trial.time))
        return replace(trial, time=readonly(even))

    dataset = spoiled(closed, "v3", dataset=dataset)
    fitted, held = dataset.split()
    problem = Problem(Model(dataset.fish), fitted, Noise.white(readonly(SIGMA)))
    found = inspect_fit(problem, fit(problem, tolerance=1e-3), {}, held)
    refuted, (row,) = weighed(found.blocks, dataset)
    assert not refuted
    assert row.names[0].startswith("clock-jump")
    assert row.gain > 1e3
    assert row.remaining < 1e-3


def test_a_correction_that_explains_nothing_is_refuted() -> None:
    """Sway that is right is said to have the wrong sign."""

    def flipped(dataset: Dataset) -> Dataset:
        return spoiled(velocity(lambda v: v * [1, -1, 1]), dataset=dataset)

    claim = Finding("signs-channel", "blocks", "all trials, sway", "a wrong sign", "port", "flip", corrected=flipped)
    other = Finding("labels-beat", "blocks", "trial 'v1'", "another beat", "its own", "correct its drive")
    refuted, (row,) = weighed((claim, other), good())
    assert row.gain < 0.0
    assert [*refuted] == [claim]
    assert refuted[claim].severity == "suspect"
    assert refuted[claim].found == "a wrong sign; yet corrected so, the nominal model fits no better"


def test_a_wrong_sign_is_a_row_of_the_table_that_the_verdict_is_read_from() -> None:
    dataset = spoiled(velocity(lambda v: v * [1, 1, -1]))
    result = diagnose(dataset, effects={"time_offset": find("time_offset")}, jobs=1)
    assert result.verdict == "cannot_tell"
    assert result.message.startswith("These data allow no verdict: all trials, yaw_rate: yaw_rate has the wrong sign")
    assert result.best == ()
    first, *others = result.table.to_dict()["rows"]
    assert first["names"] == ["signs-channel (all trials, yaw_rate)"]
    assert first["left"] < 1e-3
    assert first["behind"] is None
    assert [row["names"] for row in others] == [["time_offset"]]
