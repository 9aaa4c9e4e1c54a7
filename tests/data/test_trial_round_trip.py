"""A saved dataset is the dataset, to the last bit."""

from __future__ import annotations

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import same

from mjfish import data as trial
from mjfish.data import Dataset, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish, load_fish

finite = st.floats(-1e15, 1e15)
biases = st.tuples(*[st.floats(-3.0, 3.0)] * 4)


def columns(rows: int, width: int, elements: st.SearchStrategy[float] = finite) -> st.SearchStrategy[np.ndarray]:
    return arrays.arrays(np.float64, (rows, width), elements=elements)


@st.composite
def trials(draw: st.DrawFn, name: str) -> Trial:
    rows = draw(st.integers(40, 46))
    jitter = draw(arrays.arrays(np.float64, rows, elements=st.floats(-0.002, 0.002)))
    time = 0.1 + 0.02 * np.arange(rows) + jitter
    pose = draw(st.none() | columns(rows, 3))
    if pose is not None and draw(st.booleans()):
        pose[:, :2] = np.nan
    drive, angle = (), None
    if draw(st.booleans()):
        first = DriveSegment(0.0, draw(st.floats(10.0, 40.0)), draw(biases))
        drive = (first, DriveSegment(draw(st.floats(0.05, 0.5)), draw(st.floats(0.1, 90.0)), draw(biases)))
    else:
        angle = np.cos(20.0 * time[:, None] + np.arange(4)) + draw(columns(rows, 4, st.floats(-0.01, 0.01)))
    return Trial(
        name=name,
        role=draw(st.sampled_from([None, "fit"])),
        time=time,
        velocity=draw(columns(rows, 3)),
        drive=drive,
        joint_angle=angle,
        pose=pose,
        roll=draw(st.none() | arrays.arrays(np.float64, rows, elements=finite)),
    )


@st.composite
def fish_of_datasets(draw: st.DrawFn) -> Fish:
    fish = load_fish("pike")
    if draw(st.booleans()):
        moved = {}
        for parameter in draw(st.lists(st.sampled_from(fish.parameters), max_size=3, unique_by=lambda p: p.name)):
            low = draw(st.floats(0.0, 0.9)) * parameter.high
            high = parameter.high * draw(st.floats(1.0, 3.0))
            start = min(low + draw(st.floats(0, 1)) * (high - low), high)  # rounding may be above it
            moved[parameter.name] = parameter.rebound(low=low, high=high, start=start)
        fish = fish.with_coefficients(moved)
    if draw(st.booleans()):
        fish = fish.with_values({"c_d.head": draw(st.floats(3.7, 3.9))}) if draw(st.booleans()) else fish
        fish = fish.model_copy(update={"munk_moment": draw(st.floats(-2.0, 3.0)), "about": draw(st.text('aü"\\\n#'))})
    return fish


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    names = draw(
        st.lists(
            st.sampled_from(["v1", "v1-t2", "Lauf 3", "später", "a.b", "dataset", "fish"]),
            min_size=1,
            max_size=3,
            unique=True,
        )
    )
    return Dataset(
        name=draw(st.text(st.characters(exclude_categories=["Cs"]), min_size=1)),
        fish=draw(fish_of_datasets()),
        trials=tuple(draw(trials(name)) for name in names),
        noise=draw(st.none() | arrays.arrays(np.float64, 3, elements=st.floats(1e-300, 1e300))),
        clock=draw(st.sampled_from(["synchronised", "free"])),
    )


@given(dataset=datasets(), suffix=st.sampled_from([".csv", ".parquet"]))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_loading_what_was_saved_gives_back_every_bit(
    dataset: Dataset, suffix: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("saved") / "deep" / "dataset"
    file = trial.save(dataset, folder, suffix=suffix)
    read = trial.load_dataset(folder)
    assert same(read, dataset)
    assert read.source == file
    assert [entry.name for entry in folder.parent.iterdir()] == ["dataset"]
