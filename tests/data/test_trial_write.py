"""A folder holds a whole dataset or none, and nothing is overwritten but what was written here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from recordings import TOML, same, swap, write_folder

from mjfish import data as trial
from mjfish.data import Dataset, Trial
from mjfish.data import write as writing
from mjfish.errors import InputError, MjfishError


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """The small dataset, read from a folder of its own."""
    return trial.load_dataset(write_folder(tmp_path / "origin"))


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def only(trial_: Trial, dataset: Dataset) -> Dataset:
    return replace(dataset, trials=(trial_, *dataset.trials[1:]))


def test_the_equality_used_here_sees_a_single_bit(dataset: Dataset) -> None:
    first = dataset.trials[0]
    velocity = first.velocity.copy()
    assert same(dataset, only(replace(first, velocity=velocity), dataset))
    velocity[3, 1] = np.nextafter(velocity[3, 1], 1.0)
    assert not same(dataset, only(replace(first, velocity=velocity), dataset))
    assert not same(dataset, replace(dataset, fish=dataset.fish.with_values({"c_d.head": 1.0})))


def test_a_shipped_fish_is_written_by_name_with_what_was_changed_for_the_fit(dataset: Dataset, tmp_path: Path) -> None:
    file = trial.save(dataset, tmp_path / "out")
    assert sorted(content(tmp_path / "out")) == ["cpg.csv", "dataset.toml", "measured.csv"]
    text = file.read_text(encoding="utf-8")
    assert 'fish = "pike"' in text
    assert '[start]\n"c_d.head" = {start = 1.5}\n' in text
    assert text.splitlines()[0] == writing.MARK
    assert (tmp_path / "out" / "cpg.csv").read_text().splitlines()[:2] == [
        "time [s],surge [m/s],sway [m/s],yaw_rate [rad/s]",
        "0.0,0.0,0.0,0.0",
    ]


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_a_changed_fish_goes_along(name: str, dataset: Dataset, tmp_path: Path) -> None:
    entry = next(parameter for parameter in dataset.fish.parameters if parameter.name == name)
    changed = replace(dataset, fish=dataset.fish.with_values({name: 0.5 * (entry.low + entry.high)}))
    trial.save(changed, tmp_path / "out")
    assert sorted(content(tmp_path / "out")) == ["cpg.csv", "dataset.toml", "fish.toml", "measured.csv"]
    assert same(trial.load_dataset(tmp_path / "out"), changed)


def test_saving_again_replaces_the_dataset_and_leaves_other_files_alone(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    trial.save(replace(dataset, fish=dataset.fish.with_values({"c_d.head": 1.0})), folder)
    (folder / "notes.txt").write_text("keep me")
    smaller = replace(dataset, trials=dataset.trials[:1])
    trial.save(smaller, folder, suffix=".parquet")
    assert sorted(content(folder)) == ["cpg.parquet", "dataset.toml", "notes.txt"]
    assert same(trial.load_dataset(folder), smaller)


def test_an_empty_folder_is_filled(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    trial.save(dataset, tmp_path / "out")
    assert same(trial.load_dataset(tmp_path / "out"), dataset)


def _foreign(folder: Path) -> None:
    (folder / "thesis.tex").write_text("years of work")


def _by_hand(folder: Path) -> None:
    write_folder(folder)


def _broken(folder: Path) -> None:
    write_folder(folder, toml=swap("[noise]", "[noise")(TOML))


def _collision(folder: Path) -> None:
    text = TOML.replace("cpg.csv", "first.csv")
    write_folder(folder, toml=f"{writing.MARK}\n{text}")
    (folder / "first.csv").write_bytes((folder / "cpg.csv").read_bytes())


@pytest.mark.parametrize(
    ("fill", "expected"),
    [
        (_foreign, "holds files and no dataset.toml, expected an empty folder or a dataset; choose another folder"),
        (_by_hand, "holds a dataset that mjfish did not write, expected one that it did; choose another folder"),
        (_broken, "holds a dataset that cannot be read; choose another folder"),
        (_collision, "cpg.csv: is no file of the old dataset, and would be overwritten; move it away"),
    ],
)
def test_never_overwrites_what_it_did_not_write(
    fill: Callable[[Path], None], expected: str, dataset: Dataset, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    fill(folder)
    before = content(folder)
    with pytest.raises(InputError) as caught:
        trial.save(dataset, folder)
    assert str(folder) in str(caught.value)
    assert expected in str(caught.value)
    assert content(folder) == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["origin", "out"]


def test_refuses_a_file_in_place_of_the_folder(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="out: is a file, expected a folder; choose another name"):
        trial.save(dataset, tmp_path / "out")
    with pytest.raises(InputError, match=r"cannot be written: .*; choose another place"):
        trial.save(dataset, tmp_path / "out" / "below")


@pytest.mark.parametrize("older", [False, True])
@pytest.mark.parametrize("failing", [1, 2, 3])
def test_nothing_is_half_written_when_writing_fails(
    failing: int, older: bool, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk fills at the first table, the second, or dataset.toml; an older dataset stays what it was."""
    folder = tmp_path / "out"
    if older:
        trial.save(replace(dataset, name="older", trials=dataset.trials[:1]), folder)
    before = content(tmp_path)
    calls = 0
    write_table, write_text = trial.write_table, Path.write_text

    def count_and_fail() -> None:
        nonlocal calls
        calls += 1
        if calls == failing:
            raise OSError("no space left on device")

    def table(path: Path, table: dict[str, np.ndarray]) -> None:
        write_table(path, table)
        count_and_fail()

    def text(path: Path, *args: str, **kwargs: str) -> int:
        written = write_text(path, *args, **kwargs)
        count_and_fail()
        return written

    monkeypatch.setattr(writing, "write_table", table)
    monkeypatch.setattr(Path, "write_text", text)
    with pytest.raises(InputError, match=r"out: the dataset cannot be written: no space left on device; choose"):
        trial.save(dataset, folder)
    assert calls == failing
    assert content(tmp_path) == before
    assert folder.exists() == older
    assert not list(tmp_path.glob(".*"))


def test_nothing_is_half_written_when_interrupted(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(writing, "write_table", interrupt)
    with pytest.raises(KeyboardInterrupt):
        trial.save(dataset, tmp_path / "out")
    assert [entry.name for entry in tmp_path.iterdir()] == ["origin"]


BROKEN: dict[str, tuple[Callable[[Dataset], Dataset], str]] = {
    "NaN": (
        lambda d: only(
            replace(d.trials[0], velocity=np.where(np.arange(51)[:, None] == 3, np.nan, 0.1 * np.ones(3))), d
        ),
        "cpg.csv: row 4 (line 5), column 'surge [m/s]': nan, expected a finite number",
    ),
    "nothing measured": (
        lambda d: only(replace(d.trials[0], velocity=np.full((51, 3), np.nan)), d),
        "cpg.csv: no velocity; found time [s]; expected one of surge [m/s]",
    ),
    "rows": (lambda d: only(replace(d.trials[0], roll=np.zeros(50)), d), "roll have shape (50, 1), expected (51, 1)"),
    "half a pose": (
        lambda d: only(replace(d.trials[0], pose=np.where(np.arange(51)[:, None] < 9, np.nan, np.ones((51, 3)))), d),
        "row 1 (line 2), column 'x [m]': nan",
    ),
    "joints": (
        lambda d: only(replace(d.trials[0], drive=(), joint_angle=np.zeros((51, 3))), d),
        "column 'joint_4 [rad]' is missing",
    ),
    "both": (
        lambda d: only(replace(d.trials[0], joint_angle=np.zeros((51, 4))), d),
        "trials.1.drive: cpg.csv has measured joint angles too",
    ),
    "neither": (lambda d: only(replace(d.trials[0], drive=()), d), "trials.1: no drive, and cpg.csv has no joint"),
    "times": (lambda d: only(replace(d.trials[0], time=-d.trials[0].time), d), "cpg.csv: row 2 (line 3), column 'time"),
    "name": (lambda d: only(replace(d.trials[0], name="a/b"), d), "trials.1.name: a trial's name is also a file name"),
    "names": (lambda d: only(replace(d.trials[0], name="Measured"), d), "'measured' is also the name of trial 1"),
    "sigma": (lambda d: replace(d, noise=np.array([0.0, 1.0, 1.0])), "noise.surge: must be above 0"),
    "no trials": (lambda d: replace(d, trials=()), "trials: "),
    "held out": (
        lambda d: replace(d, trials=tuple(replace(t, role="held_out") for t in d.trials)),
        "every role is 'held_out'",
    ),
    "fish": (
        lambda d: replace(d, fish=d.fish.model_copy(update={"density": -1.0})),
        "fish.toml: density: must be above 0",
    ),
    "no text": (
        lambda d: replace(d, fish=d.fish.model_copy(update={"about": "\ud800"})),
        "the dataset cannot be written: 'utf-8' codec",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_refuses_to_save_what_could_not_be_loaded(case: str, dataset: Dataset, tmp_path: Path) -> None:
    change, expected = BROKEN[case]
    with pytest.raises(MjfishError) as caught:
        trial.save(change(dataset), tmp_path / "out")
    assert "the dataset cannot be" in str(caught.value)
    assert expected in str(caught.value)
    assert [entry.name for entry in tmp_path.iterdir()] == ["origin"]
