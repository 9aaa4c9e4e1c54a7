"""Sensors and missing velocities in a dataset's files: what is read, what is left out and said, what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset, Sensor, save
from mjfish.errors import InputError, MjfishError
from mjfish.numerics.arrays import FloatArray

TOML = """\
schema = 1
name = "pool"
fish = "pike"

[[trials]]
name = "run"
{file}
[[trials.drive]]
start = 0.0
omega = 18.0
bias = [0, 0, 0, 0]

[[trials.sensors]]
{sensor}
"""
POSITION = 'kind = "position"\nfile = "tag.csv"\nplace = {link = "head", station = 0.05}'
IMU = 'kind = "imu"\nfile = "imu.csv"\nplace = {link = "head", station = 0.05}'


def _table(headers: str, *columns: FloatArray) -> str:
    rows = (",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in np.stack(columns, axis=1))
    return "\n".join([headers, *rows]) + "\n"


def _track(time: FloatArray) -> tuple[FloatArray, ...]:
    return time, 0.3 * time + 0.01 * np.sin(7.0 * time), 0.02 * np.cos(9.0 * time)


def _read(folder: Path, sensor: str = POSITION, file: str = "", **files: str) -> Dataset:
    files = {"tag": _table("time [s],x [m],y [m]", *_track(np.arange(60) / 30.0)), **files}
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    (folder / "dataset.toml").write_text(TOML.format(sensor=sensor, file=file), encoding="utf-8")
    return mjfish.load_dataset(folder)


def test_a_run_of_a_tracked_point_alone_has_the_times_of_the_track(tmp_path: Path) -> None:
    (trial,) = _read(tmp_path).trials
    (tag,) = trial.sensors
    assert (tag.name, tag.kind, tag.link, tag.station, tag.sigma, tag.free_clock) == (
        "position", "position", 0, 0.05, None, False,
    )  # fmt: skip
    assert np.array_equal(trial.time, tag.time)
    assert not trial.measured.any()
    assert "with position" in repr(trial)


def test_headers_of_another_program_are_named_in_columns(tmp_path: Path) -> None:
    sensor = POSITION + '\ncolumns = {time = "t", x = "nose X", y = "nose Y"}\nsigma = [0.001, 0.002]\nclock = "free"'
    text = _table("frame,t,nose X,nose Y", np.arange(60.0), *_track(np.arange(60) / 30.0))
    ((tag,),) = [trial.sensors for trial in _read(tmp_path, sensor, tag=text).trials]
    assert tag.values[:, 1] == pytest.approx(_track(tag.time)[2])
    assert tag.free_clock
    assert list(tag.sigma if tag.sigma is not None else ()) == [0.001, 0.002]


def test_dropouts_repeats_and_samples_outside_of_the_run_are_left_out_and_said(tmp_path: Path) -> None:
    time = np.arange(-5, 115) / 50.0
    x, y = _track(np.floor(time * 25.0) / 25.0)[1:]  # logged twice as fast as measured
    x[40] = np.nan
    time[61] = time[60]
    run = np.arange(101) / 50.0
    swum = _table("time [s],surge [m/s]", run, 0.1 + 0.1 * run)
    (trial,) = _read(
        tmp_path, POSITION, 'file = "run.csv"', tag=_table("time [s],x [m],y [m]", time, x, y), run=swum
    ).trials
    (tag,) = trial.sensors
    assert np.all(np.diff(tag.time) > 0.0)
    assert tag.step == pytest.approx(0.04)
    assert tag.time[0] >= 0.0
    assert tag.time[-1] <= 2.0
    said = " / ".join(tag.remarks)
    for part in (
        "1 of 120",
        "a value is missing",
        "their time repeats",
        "repeat the values before",
        "outside of the run",
    ):
        assert part in said, part
    assert trial.measured.tolist() == [True, False, False]


@pytest.mark.parametrize("digit", [1.0, 0.1, 0.01])
def test_values_that_repeat_by_rounding_are_kept(tmp_path: Path, digit: float) -> None:
    """A heading that turns slowly, in degrees. Left out, those before each change of the last digit would be missed."""
    time = np.arange(300) / 30.0
    noisy = 10.0 + 2.0 * time + np.random.default_rng(1).normal(0.0, 0.3, 300)
    rounded = np.radians(digit * np.round(noisy / digit))
    sensor = 'kind = "heading"\nname = "compass"\nfile = "compass.csv"'
    (trial,) = _read(tmp_path, sensor, compass=_table("time [s],yaw [rad]", time, rounded)).trials
    assert len(trial.sensors[0].time) == 300
    assert trial.sensors[0].remarks == ()


def test_frozen_frames_are_left_out(tmp_path: Path) -> None:
    time, x, y = _track(np.arange(300) / 30.0)
    x, y = (np.round(v + np.random.default_rng(1).normal(0.0, 1e-3, 300), 6) for v in (x, y))
    x[100:103], y[100:103] = x[99], y[99]
    (trial,) = _read(tmp_path, tag=_table("time [s],x [m],y [m]", time, x, y)).trials
    assert len(trial.sensors[0].time) == 297
    assert "3 of 300 samples left out: they repeat the values before" in trial.sensors[0].remarks[0]


def test_a_gap_stays_a_gap(tmp_path: Path) -> None:
    time = np.delete(np.arange(90) / 30.0, np.s_[30:45])
    (trial,) = _read(tmp_path, tag=_table("time [s],x [m],y [m]", *_track(time))).trials
    assert len(trial.sensors[0].time) == 75
    assert trial.sensors[0].step == pytest.approx(1.0 / 30.0)


def test_a_heading_has_no_jump_of_a_turn(tmp_path: Path) -> None:
    time = np.arange(60) / 30.0
    wrapped = np.mod(3.0 + time + np.pi, 2.0 * np.pi) - np.pi
    sensor = 'kind = "heading"\nname = "compass"\nfile = "compass.csv"'
    (trial,) = _read(tmp_path, sensor, compass=_table("time [s],yaw [rad]", time, wrapped)).trials
    assert trial.sensors[0].values[:, 0] == pytest.approx(3.0 + time)


REFUSED = {
    "no place": (POSITION.replace("place", "#"), ("sensors.1.place: missing", "position sits", "station in m")),
    "no such link": (POSITION.replace('"head"', '"fin"'), ("place.link: no link 'fin'", "expected one of head")),
    "off the link": (POSITION.replace("0.05", "0.9"), ("place.station: 0.9 m is off the link 'head'", "m long")),
    "imu on a link behind": (
        IMU.replace('"head"', '"tail"'), ("place.link: 'tail', expected 'head'", "leave the sensor out"),
    ),
    "imu without accelerations": (IMU, ("column 'surge_acceleration [m/s2]' is missing", "add it")),
    "sigmas": (POSITION + "\nsigma = [0.1]", ("sigma: 1 numbers, expected one for each of x, y", "correct it")),
    "sigma of nothing": (POSITION + "\nsigma = [0.1, 0.0]", ("sigma", "must be above 0", "estimated")),
    "columns": (POSITION + '\ncolumns = {x = "x"}', ("columns: 'time', 'y' missing", "header of each")),
    "columns of another kind": (
        POSITION + '\ncolumns = {time = "t", x = "x", y = "y", yaw = "w"}', ("columns: 'yaw' unknown",),
    ),
    "no such header": (POSITION + '\ncolumns = {time = "t", x = "x", y = "y"}', ("unknown column in", "'t'")),
    "name": (POSITION + '\nname = "start"', ("sensor's name", "rename the sensor")),
    "names": (f"{POSITION}\n[[trials.sensors]]\n{POSITION}", ("'position' is also the name of another sensor",)),
    "no file": (POSITION.replace("tag.csv", "none.csv"), ("none.csv: no such file",)),
    "kind": (POSITION.replace('"position"', '"sonar"'), ("kind", "'position'")),
}  # fmt: skip


@pytest.mark.parametrize(("sensor", "parts"), REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_with_a_sensor_is_refused_by_its_place(
    tmp_path: Path, sensor: str, parts: tuple[str, ...]
) -> None:
    imu = _table("time [s],yaw_rate [rad/s]", *_track(np.arange(60) / 30.0)[:2])
    with pytest.raises(MjfishError) as error:
        _read(tmp_path, sensor, imu=imu)
    for part in parts:
        assert part in str(error.value), str(error.value)


def test_a_sensor_on_another_clock_is_refused(tmp_path: Path) -> None:
    run = np.arange(101) / 50.0
    swum = _table("time [s],surge [m/s]", run, 0.1 + 0.1 * run)
    late = _table("time [s],x [m],y [m]", *_track(100.0 + np.arange(60) / 30.0))
    with pytest.raises(
        InputError, match=r"tag\.csv: its times, 100 to 101\.967 s, hardly overlap .* 0 to 2 s.*clock of"
    ):
        _read(tmp_path, POSITION, 'file = "run.csv"', tag=late, run=swum)


def test_times_that_run_backwards_are_refused(tmp_path: Path) -> None:
    time = np.arange(60) / 30.0
    time[20] = 0.1
    with pytest.raises(InputError, match=r"row 21 \(line 22\).*0\.1 s is before.*sort the rows"):
        _read(tmp_path, tag=_table("time [s],x [m],y [m]", *_track(time)))


@pytest.mark.parametrize("there", [5, 0])
def test_hardly_any_sample_is_refused(tmp_path: Path, there: int) -> None:
    time, x, y = _track(np.arange(60) / 30.0)
    x[there:] = np.nan
    said = rf"{there} samples of 'position' can be used, expected 8 .*{60 - there} of 60 .* missing"
    with pytest.raises(InputError, match=said):
        _read(tmp_path, tag=_table("time [s],x [m],y [m]", time, x, y))


def test_a_trial_in_which_nothing_was_measured_is_refused(tmp_path: Path) -> None:
    text = TOML.format(sensor="", file="").replace("[[trials.sensors]]", "")
    (tmp_path / "dataset.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"trials\.1: no file and no \[\[trials\.sensors\]\]"):
        mjfish.load_dataset(tmp_path)
    (tmp_path / "dataset.toml").write_text(text.replace('"run"', '"run"\nfile = "run.csv"'), encoding="utf-8")
    (tmp_path / "run.csv").write_text(
        _table("time [s],roll [rad]", np.arange(60) / 30.0, np.zeros(60)), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"run\.csv: no velocity; found time \[s\], roll.*\[\[trials\.sensors\]\]"):
        mjfish.load_dataset(tmp_path)


def test_a_stated_noise_must_have_what_was_measured(tmp_path: Path) -> None:
    run = np.arange(101) / 50.0
    swum = _table("time [s],surge [m/s],sway [m/s]", run, 0.1 + 0.1 * run, 0.1 * np.sin(run))
    file = 'file = "run.csv"\n'
    _read(tmp_path, POSITION, file, run=swum)
    toml = tmp_path / "dataset.toml"
    toml.write_text(toml.read_text().replace("[[trials]]", "[noise]\nsurge = 0.01\n[[trials]]"), encoding="utf-8")
    with pytest.raises(InputError, match=r"noise\.sway: this key is missing, and trial 'run' has sway"):
        mjfish.load_dataset(tmp_path)
    toml.write_text(toml.read_text().replace("surge = 0.01", "surge = 0.01\nsway = 0.02"), encoding="utf-8")
    noise = mjfish.load_dataset(tmp_path).noise
    assert noise is not None
    assert noise.tolist()[:2] == [0.01, 0.02]
    assert np.isnan(noise[2])


def _recorded(gap: int) -> Dataset:
    """A filmed run with recorded joints that beat at 2 Hz; from row 100 on, the joints of some rows are missing."""
    pool = mjfish.generate("pike", ["v1"], noise=(1e-3, 1e-3, 0.01), duration=6.0, observe="pose", joints="measured")
    (trial,) = pool.trials
    rows = np.delete(np.arange(len(trial.time)), np.s_[100 : 100 + gap])
    angle = 0.2 * np.sin(4.0 * np.pi * trial.time[rows, None] - np.arange(4.0))
    cut = replace(trial, time=trial.time[rows], velocity=trial.velocity[rows], joint_angle=angle)
    return replace(pool, trials=(cut,))


def test_joints_without_velocities_may_have_gaps_that_a_spline_bridges(tmp_path: Path) -> None:
    """A beat of 25 rows: 5 of them may miss, the files give back what was recorded; 8 may not."""
    (before,) = _recorded(5).trials
    save(_recorded(5), tmp_path / "pool")
    (after,) = mjfish.load_dataset(tmp_path / "pool").trials
    assert np.array_equal(after.time, before.time)
    assert before.joint_angle is not None
    assert after.joint_angle is not None
    assert np.array_equal(after.joint_angle, before.joint_angle)
    assert not after.measured.any()
    for old, new in zip(before.sensors, after.sensors, strict=True):
        assert np.array_equal(old.values, new.values)
    with pytest.raises(
        InputError, match=r"v1\.csv: row 101 \(line 102\): no joint angles from 1\.98 to 2\.16 s.*cut the run there"
    ):
        save(_recorded(8), tmp_path / "other")


def test_what_is_saved_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    time = np.arange(90) / 40.0
    sensors = (
        Sensor(
            "tag", "position", time, np.zeros((90, 2)), link=2, station=0.03, sigma=np.full(2, 1e-3), free_clock=True
        ),
        Sensor("imu", "imu", time, np.zeros((90, 3)), station=0.1, sigma=np.array([0.02, 0.2, 0.2])),
        Sensor("gyro", "gyro", time, np.zeros((90, 1)), sigma=np.array([0.01])),
    )
    pool = mjfish.generate("pike", ["v1"], noise=(0.01, 0.01, 0.05), duration=2.5, sensors=sensors)
    velocity = pool.trials[0].velocity.copy()
    velocity[:, 1] = np.nan
    noise = np.array([0.01, np.nan, 0.05])
    pool = replace(pool, trials=(replace(pool.trials[0], velocity=velocity),), noise=noise)
    save(pool, tmp_path / "pool")
    save(pool, tmp_path / "pool")  # over itself: its files are known
    (before,), back = pool.trials, mjfish.load_dataset(tmp_path / "pool")
    (after,) = back.trials
    assert np.array_equal(after.velocity, before.velocity, equal_nan=True)
    assert back.noise is not None
    assert np.array_equal(back.noise, noise, equal_nan=True)
    for old, new in zip(before.sensors, after.sensors, strict=True):
        assert np.array_equal(old.values, new.values)
        assert np.array_equal(old.time, new.time)
        for name in ("name", "kind", "link", "station", "free_clock"):
            assert getattr(old, name) == getattr(new, name)
        assert old.sigma is not None
        assert new.sigma is not None
        assert np.array_equal(old.sigma, new.sigma)
