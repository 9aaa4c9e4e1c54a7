"""Which file belongs to which trial, and files that are refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from measured_and_simulated import clean, measured, write

from mjfish.comparison.comparison import assign_rollouts, read_rollout
from mjfish.data import Dataset, Trial
from mjfish.errors import InputError
from mjfish.fish.frames import CHANNELS


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return measured(tmp_path_factory.mktemp("measured") / "pool")


@pytest.fixture
def trials(pool: Dataset) -> tuple[Trial, ...]:
    return pool.trials


def _touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("", encoding="utf-8")
    return path


def test_files_are_found_by_name_in_folders_and_folders_of_folders(trials: tuple[Trial, ...], tmp_path: Path) -> None:
    """As `mjfish simulate --out DIR/v3` leaves it, too; capitals do not matter, other tables are told."""
    first, second = _touch(tmp_path / "V1.csv"), _touch(tmp_path / "v3" / "rollout.csv")
    other = _touch(tmp_path / "notes.csv")
    _touch(tmp_path / "v3" / "rollout.rrd")
    _touch(tmp_path / "readme.txt")
    assert assign_rollouts([tmp_path], trials) == ({"v1": first, "v3": second}, (other,))
    assert assign_rollouts([first, tmp_path / "v3"], trials) == ({"v1": first, "v3": second}, ())


def test_a_single_file_for_a_single_trial_may_have_any_name(trials: tuple[Trial, ...], tmp_path: Path) -> None:
    file = _touch(tmp_path / "mine.parquet")
    assert assign_rollouts([file], trials[:1]) == ({"v1": file}, ())
    assert assign_rollouts([tmp_path], trials[:1]) == ({"v1": file}, ())
    with pytest.raises(InputError, match=r"mine\.parquet: no trial is called 'mine'; expected files named as"):
        assign_rollouts([file], trials)


def test_what_cannot_be_assigned_is_refused(pool: Dataset, trials: tuple[Trial, ...], tmp_path: Path) -> None:
    """Catches a measurement that is compared with itself, and one of two files that silently wins."""
    with pytest.raises(InputError, match=r"absent: no such file or folder; name a folder of rollouts"):
        assign_rollouts([tmp_path / "absent"], trials)
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        InputError, match=r"no rollout of any trial; found no tables; expected files .*: v1.csv, v3.csv"
    ):
        assign_rollouts([tmp_path / "empty"], trials)
    _touch(tmp_path / "others" / "a.csv")
    _touch(tmp_path / "others" / "b.csv")
    with pytest.raises(InputError, match=r"no rollout of any trial; found a\.csv, b\.csv"):
        assign_rollouts([tmp_path / "others"], trials)
    _touch(tmp_path / "turn" / "rollout.csv")
    with pytest.raises(InputError, match=r"found turn/rollout\.csv; .* or folders so named with a rollout\.csv"):
        assign_rollouts([tmp_path / "turn"], trials)
    _touch(tmp_path / "two" / "v1.csv")
    _touch(tmp_path / "two" / "v1.parquet")
    with pytest.raises(InputError, match=r"v1\.parquet: '.*v1\.csv' is a rollout of the trial 'v1' already"):
        assign_rollouts([tmp_path / "two"], trials)
    with pytest.raises(InputError, match=r"v1\.m: the name ends in '\.m', expected \.csv or \.parquet"):
        assign_rollouts([_touch(tmp_path / "v1.m")], trials)
    assert pool.source is not None
    with pytest.raises(InputError, match=r"v1\.csv: is the measurement of the trial 'v1'; name the folder"):
        assign_rollouts([pool.source.parent], trials)


BROKEN = {
    "no time": ("surge [m/s]\n1\n2\n", r"column 'time \[s\]' is missing; found surge \[m/s\]; add it"),
    "no velocity": ("time [s],yaw [rad]\n0,1\n1,2\n", r"has no velocity, expected one or more of surge \[m/s\]"),
    "one row": ("time [s],surge [m/s]\n0,1\n", "has 1 row, expected a run over the time of its trial; simulate longer"),
    "time repeats": ("time [s],surge [m/s]\n0,1\n0,2\n", r"row 2 \(line 3\), column 'time \[s\]': 0 s repeats"),
    "time falls": ("time [s],surge [m/s]\n1,1\n0,2\n", "0 s is before the 1 s of row 1, .*; sort the rows by time"),
    "unit": ("time [s],yaw_rate [deg/s]\n0,1\n1,2\n", r"unit \[deg/s\], expected \[rad/s\]; .*multiply by pi/180"),
    "nan": ("time [s],surge [m/s]\n0,1\n1,nan\n", r"row 2 \(line 3\), column 'surge \[m/s\]': nan, expected a finite"),
    "unknown": ("time [s],Vx\n0,1\n1,2\n", "column 2 'Vx': unknown column; .*; rename or remove it"),
}


@pytest.mark.parametrize(("content", "complaint"), BROKEN.values(), ids=BROKEN)
def test_a_broken_file_is_refused_by_place_and_remedy(tmp_path: Path, content: str, complaint: str) -> None:
    path = tmp_path / "v1.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=complaint) as told:
        read_rollout(path)
    assert re.match(re.escape(str(path)), str(told.value))


def test_between_samples_the_run_is_smooth_at_them_it_is_exact(tmp_path: Path) -> None:
    """100 Hz to the middles of its steps: a small part of what lines between the samples would leave."""
    time, velocity = clean(200.0)["v1"]
    run = read_rollout(write(tmp_path / "v1.csv", time[::2], velocity[::2]))
    np.testing.assert_allclose(run.at(time[::2]), velocity[::2], rtol=0, atol=1e-14)
    late = time[1::2] > 0.5
    error = np.abs(run.at(time[1::2]) - velocity[1::2])[late].max(axis=0)
    line = np.abs(0.5 * (velocity[:-2:2] + velocity[2::2]) - velocity[1::2])[late].max(axis=0)
    assert np.all(error < 0.1 * line)
    assert np.all(error < 2e-4 * np.ptp(velocity, axis=0))


def test_a_step_in_the_run_is_smeared_over_few_samples(tmp_path: Path) -> None:
    time = np.arange(101) / 50.0
    velocity = np.tile((time > 1.0)[:, None].astype(float), (1, 3))
    run = read_rollout(write(tmp_path / "v1.csv", time, velocity))
    middles = np.arange(0.01, 1.99, 0.02)
    far = np.abs(middles - 1.01) > 0.1
    np.testing.assert_allclose(run.at(middles)[far, 0], (middles > 1.0)[far], rtol=0, atol=1e-3)


def test_steps_of_a_solver_may_be_of_any_length(tmp_path: Path) -> None:
    """As MATLAB's ode45 leaves them."""
    time, velocity = clean(1000.0)["v1"]
    kept = np.cumsum(np.random.default_rng(1).integers(1, 14, 700))
    kept = np.array([0, *kept[kept < len(time) - 1], len(time) - 1])
    run = read_rollout(write(tmp_path / "v1.csv", time[kept], velocity[kept]))
    late = time > 0.5
    assert np.all(np.abs(run.at(time) - velocity)[late].max(axis=0) < 1e-3 * np.ptp(velocity, axis=0))


def test_beyond_its_ends_and_in_missing_channels_there_are_no_numbers(tmp_path: Path) -> None:
    """But a last sample that was rounded away is met."""
    time, velocity = clean(50.0)["v1"]
    run = read_rollout(write(tmp_path / "v1.csv", time, velocity, ("sway",)))
    asked = np.array([-0.1, 0.0, time[-1] + 1e-9, time[-1] + 0.01])
    found = run.at(asked)
    assert run.channels == ("sway",)
    assert np.isnan(found[:, [0, 2]]).all()
    assert np.isnan(found[:, CHANNELS.index("sway")]).tolist() == [True, False, False, True]
