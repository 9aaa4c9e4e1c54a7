"""The menu holds runs that the fish can swim and a dataset can record, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_trials import synthetic

from mjfish.data import Dataset, validation
from mjfish.design.menu import Menu
from mjfish.drive import cpg, modes
from mjfish.errors import InputError


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return synthetic("time_offset", {"time_offset.offset": -0.01}, ("v1", "v3"))


def test_no_run_asks_more_of_a_joint_than_the_hardest_known_mode(dataset: Dataset) -> None:
    """Omega 60 would double the joints' rates: a menu that does not look at them would offer it."""
    fish = dataset.fish
    assert fish.cpg is not None
    hardest = [cpg.joint_motion(fish.cpg, modes.drive(mode), modes.DURATION, 0.005) for mode in modes.MODES]
    angle = max(float(np.abs(motion.angle).max()) for motion in hardest)
    rate = max(float(np.abs(motion.rate).max()) for motion in hardest)
    runs = Menu(omega=(9.0, 60.0)).runs(dataset)
    for run in runs:
        motion = cpg.joint_motion(fish.cpg, run.trial.drive, float(run.trial.time[-1]), 0.005)
        assert np.abs(motion.angle).max() <= 1.05 * angle + 1e-9, run.name
        assert np.abs(motion.rate).max() <= 1.05 * rate + 1e-9, run.name
    fastest = max(segment.omega for run in runs for segment in run.trial.drive)
    assert 20.0 < fastest < 36.0


def test_every_run_is_one_that_a_dataset_may_hold(dataset: Dataset) -> None:
    """Sampled like the data, named apart, of segments that a recording passes with."""
    runs = Menu().runs(dataset)
    assert len({run.name for run in runs} | {"v1", "v3"}) == len(runs) + 2
    assert {run.name for run in runs if run.repeat} == {"v1-again", "v3-again"}
    for run in runs:
        np.testing.assert_allclose(np.diff(run.trial.time), 0.02)
        assert run.seconds == pytest.approx(4.0)
        validation.check_cpg(run.trial.time, run.trial.drive, dataset.fish, Path("run.csv"), run.name)
    kinds = {run.name.split("-")[0] for run in runs}
    assert {"steady", "turn", "into", "step", "chirp", "zigzag", "burst", "coast"} <= kinds


def test_a_bend_that_is_held_is_offered_where_a_beat_before_it_has_time(dataset: Dataset) -> None:
    names = {run.name for run in Menu(duration=10.0).runs(dataset)}
    assert "c-bend" in names


def test_a_run_that_was_swum_is_not_offered_as_new(dataset: Dataset) -> None:
    again = replace(dataset, trials=(*dataset.trials, replace(dataset.trials[0], name="zigzag")))
    names = [run.name for run in Menu().runs(again)]
    assert "zigzag" not in names


def test_without_a_cpg_only_repeats_can_be_asked_for(dataset: Dataset) -> None:
    fish = dataset.fish.model_copy(update={"cpg": None})
    assert all(run.repeat for run in Menu().runs(replace(dataset, fish=fish)))


def test_numbers_that_no_run_can_have_are_refused() -> None:
    with pytest.raises(InputError, match="expected 1 s or more"):
        Menu(duration=0.2)
    with pytest.raises(InputError, match="slowest < fastest"):
        Menu(omega=(20.0, 9.0))
