"""A valid dataset is read as it is written down, in every dialect that means the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import ROWS, TOML, cell, cpg_csv, lines, refusal, swap, with_column, write_folder

from mjfish import data as trial
from mjfish.drive.cpg import DriveSegment


def test_reads_what_is_written_down(tmp_path: Path) -> None:
    dataset = trial.load_dataset(write_folder(tmp_path))
    cpg, measured = dataset.trials
    assert (dataset.name, dataset.fish.name, dataset.clock) == ("pool", "pike", "synchronised")
    assert dataset.noise is not None
    assert dataset.noise.tolist() == [0.01, 0.01, 0.05]
    assert dataset.source == tmp_path / "dataset.toml"
    assert cpg.drive == (
        DriveSegment(0.0, 18.0, (0.0, 0.0, 0.0, 0.0)),
        DriveSegment(0.5, 22.0, (0.0, 1.0, 1.5, 2.0)),
    )
    assert cpg.starts_at_rest
    assert cpg.joint_angle is None
    assert cpg.source == tmp_path / "cpg.csv"
    assert not measured.starts_at_rest
    assert measured.joint_angle is not None
    assert measured.joint_angle.shape == (ROWS, 4)
    np.testing.assert_array_equal(measured.time, np.round(np.arange(ROWS) * 0.02, 6))
    np.testing.assert_array_equal(measured.velocity[:, 0], 0.2 * measured.time)
    assert not measured.velocity.flags.writeable


def test_columns_are_found_by_name_whatever_their_order_and_the_dialect_of_the_csv(tmp_path: Path) -> None:
    plain = trial.load_dataset(write_folder(tmp_path / "plain")).trials[0]
    turned = "\r\n".join(",".join(reversed(line.split(","))) for line in cpg_csv().splitlines())
    dialect = "\ufeff" + turned.replace("surge [m/s]", '" surge[m/s] "').replace("0.004,", " +4e-3 ,") + "\r\n\r\n"
    read = trial.load_dataset(write_folder(tmp_path / "dialect", cpg=dialect)).trials[0]
    np.testing.assert_array_equal(read.velocity, plain.velocity)
    np.testing.assert_array_equal(read.time, plain.time)


@pytest.mark.parametrize("toml_start", ["c_d.head = 1.5", '"c_d.head" = 1.5', '"c_d.head" = { start = 1.5 }'])
def test_start_table_moves_the_start_and_nothing_else(toml_start: str, tmp_path: Path) -> None:
    read = trial.load_dataset(write_folder(tmp_path, toml=swap("c_d.head = 1.5", toml_start)(TOML))).fish
    untouched = trial.load_dataset(write_folder(tmp_path, toml=swap("c_d.head = 1.5", "")(TOML))).fish
    changed = {a.name: (a, b) for a, b in zip(untouched.parameters, read.parameters, strict=True) if a != b}
    assert set(changed) == {"c_d.head"}
    before, after = changed["c_d.head"]
    assert (after.start, after.low, after.high, after.default) == (1.5, before.low, before.high, before.default)


def test_start_table_widens_bounds_beyond_those_of_the_fish(tmp_path: Path) -> None:
    table = 'c_f.tail = { start = 0.03, low = 0.002, high = 0.1 }\n"c_m.head" = { low = 0.2 }'
    fish = trial.load_dataset(write_folder(tmp_path, toml=swap("c_d.head = 1.5", table)(TOML))).fish
    declared = {parameter.name: parameter for parameter in fish.parameters}
    tail, head = declared["c_f.tail"], declared["c_m.head"]
    assert (tail.start, tail.low, tail.high, tail.default) == (0.03, 0.002, 0.1, 0.02)
    # The fish's value 0.01 lies below the new bound, and moves onto it.
    assert (head.start, head.low, head.high, head.default) == (0.5, 0.2, 3.0, 0.2)


def test_noise_is_optional_and_files_may_lie_below_or_be_links(tmp_path: Path) -> None:
    toml = TOML.replace("[noise]\nsurge = 0.01\nsway = 0.01\nyaw_rate = 0.05\n", "")
    toml = toml.replace('"cpg.csv"', '"runs/../runs/cpg.csv"').replace('"measured.csv"', '"..measured.csv"')
    write_folder(tmp_path)
    (tmp_path / "inner" / "runs").mkdir(parents=True)
    (tmp_path / "inner" / "dataset.toml").write_text(toml)
    (tmp_path / "inner" / "runs" / "cpg.csv").symlink_to(tmp_path / "cpg.csv")
    (tmp_path / "inner" / "..measured.csv").symlink_to(tmp_path / "measured.csv")
    dataset = trial.load_dataset(tmp_path / "inner" / "dataset.toml")
    assert dataset.noise is None
    assert len(dataset.trials) == 2


def test_yaw_alone_is_a_pose_without_position(tmp_path: Path) -> None:
    pose = trial.load_dataset(write_folder(tmp_path, cpg=with_column("yaw [rad]", "0.3")(cpg_csv()))).trials[0].pose
    assert pose is not None
    assert np.isnan(pose[:, :2]).all()
    assert set(pose[:, 2]) == {0.3}


def test_a_jittering_clock_is_no_gap_and_a_lost_sample_is(tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    jitter = [0.0, *(0.02 * k + generator.uniform(-0.004, 0.004) for k in range(1, ROWS))]

    def retimed(text: str) -> str:
        for row, instant in enumerate(jitter, start=1):
            text = cell(row, 0, repr(float(instant)))(text)
        return text

    text = retimed(cpg_csv())
    assert len(trial.load_dataset(write_folder(tmp_path, cpg=text)).trials[0].time) == ROWS
    lost = lines(lambda all_: all_[:20] + all_[21:])(text)
    assert "row 20 (line 21): a gap" in refusal(write_folder(tmp_path, cpg=lost))


def test_one_whole_beat_is_enough(tmp_path: Path) -> None:
    """18 samples of 0.02 s make 0.36 s, a beat of 0.349 s; the first and last of them are only 0.34 s apart."""
    toml = TOML.replace("[[trials.drive]]\nstart = 0.5\nomega = 22.0\nbias = [0, 1, 1.5, 2]\n", "")
    rows = {count: lines(lambda all_, count=count: all_[: count + 1])(cpg_csv()) for count in (17, 18)}
    assert trial.load_dataset(write_folder(tmp_path, toml=toml, cpg=rows[18])).trials[0].time.size == 18
    assert "expected one beat" in refusal(write_folder(tmp_path, toml=toml, cpg=rows[17]))
