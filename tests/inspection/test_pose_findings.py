"""Places and headings that cannot be right are found before any fit, with the option that mends them.

None is found in data that are right: of simulated fish far from the nominal one, and of two foreign simulators.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bad_data import only, wrong

import mjfish
from mjfish.data import Dataset, Sensor, Trial
from mjfish.data.importers.mapping import PosesMap
from mjfish.data.importers.tables import import_mapped
from mjfish.drive.wave import Wave
from mjfish.effects import find
from mjfish.files import tomlfile
from mjfish.fish import load_fish
from mjfish.inspection import Finding, inspect
from mjfish.inspection.poses import pose_findings
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import Joints

MODES = ("v1", "v3-t1", "v5", "v3-t2")
PLACES = ((0.0, 0.0, 0.5), (1.0, 0.0, 2.5), (0.0, 1.0, -2.0), (0.5, 0.5, -0.6))
NOISE = (1e-3, 1e-3, 0.01)
Values = Callable[[FloatArray, Trial], FloatArray]


@cache
def filmed(joints: Joints = "measured", modes: tuple[str, ...] = MODES, late: float = 0.0) -> Dataset:
    """Return runs of a fish off the nominal one that was filmed; joints were recorded with noise, servos are late."""
    true = {"c_d.head": 2.0, "c_d.tail": 1.0, "c_m.body": 0.6, **({"servo_delay.time": late} if late else {})}
    return mjfish.generate(
        "pike", modes, values=true, noise=NOISE, seed=3, held_out=modes[1:2], duration=7.2, observe="pose",
        places=PLACES[: len(modes)], joints=joints, joint_noise=0.005,
    )  # fmt: skip


def spoiled(
    place: Values | None = None, heading: Values | None = None, *names: str, dataset: Dataset | None = None
) -> Dataset:
    """Return the runs, or those of these names, with other places (n, 2) or headings (n, 1); these without jumps."""

    def changed(trial: Trial) -> Trial:
        sensors = []
        for sensor in trial.sensors:
            change = place if sensor.kind == "position" else heading
            values = sensor.values if change is None else change(sensor.values.copy(), trial)
            sensors.append(replace(sensor, values=values if sensor.kind == "position" else np.unwrap(values, axis=0)))
        return replace(trial, sensors=tuple(sensors))

    base = filmed() if dataset is None else dataset
    return replace(base, trials=tuple(changed(t) if not names or t.name in names else t for t in base.trials))


def poses(dataset: Dataset) -> list[Finding]:
    return [finding for finding in wrong(inspect(dataset)) if finding.code.startswith("poses")]


@pytest.mark.parametrize(("joints", "late"), [("measured", 0.0), ("commanded", 0.02), ("commanded", 0.12)])
@pytest.mark.parametrize("modes", [MODES, ("v1", "v5")])
def test_right_poses_have_no_finding(joints: Joints, late: float, modes: tuple[str, ...]) -> None:
    """Servos late by half a beat are no mirrored ones, nor are they of another link."""
    assert poses(filmed(joints, modes, late)) == []


def _mirrored(values: FloatArray, trial: Trial) -> FloatArray:
    del trial
    return values * [1.0, -1.0]


def _clockwise(values: FloatArray, trial: Trial) -> FloatArray:
    del trial
    return 0.4 - values


def _of_link(number: int) -> Values:
    def turned(values: FloatArray, trial: Trial) -> FloatArray:
        assert trial.joint_angle is not None
        return np.asarray(values + trial.joint_angle[:, :number].sum(axis=1, keepdims=True))

    return turned


def _wrapped(values: FloatArray, trial: Trial) -> FloatArray:
    del trial
    return np.degrees((values + np.pi) % (2.0 * np.pi) - np.pi)


def _times(factor: float) -> Values:
    return lambda values, _: factor * values


def _plus(angle: float) -> Values:
    return lambda values, _: values + angle


#: Change of places, change of headings, code, channels, option.
WRONG: dict[str, tuple[Values | None, Values | None, str, str, str]] = {
    "image with y down": (_mirrored, _clockwise, "poses-mirrored", "position and heading", "--set axes=y_down"),
    "y down alone": (_mirrored, None, "poses-mirrored", "position", "--set axes=y_down --set turn_to=port"),
    "clockwise heading": (None, _clockwise, "poses-mirrored", "heading", "--set turn_to=starboard"),
    "tail first": (None, _plus(np.pi), "poses-heading-zero", "heading", "--set yaw_zero=VALUE"),
    "compass": (None, _plus(0.5 * np.pi), "poses-heading-zero", "heading", "--set yaw_zero=VALUE"),
    "mm": (_times(1e3), None, "poses-unit", "position", "--length-unit mm"),
    "cm": (_times(1e2), None, "poses-unit", "position", "--length-unit cm"),
    "m as mm": (_times(1e-3), None, "poses-unit", "position", "--length-unit m"),
    "degrees": (None, _wrapped, "poses-unit", "heading", "--angle-unit deg"),
    "radians as degrees": (None, _times(np.pi / 180.0), "poses-unit", "heading", "--angle-unit rad"),
    "tail": (None, _of_link(4), "poses-heading-link", "heading", "--heading COLUMN"),
}


@pytest.mark.parametrize(("place", "heading", "code", "channel", "option"), WRONG.values(), ids=WRONG)
def test_a_wrong_import_is_found_with_the_option_that_mends_it(
    place: Values | None, heading: Values | None, code: str, channel: str, option: str
) -> None:
    inspected = inspect(spoiled(place, heading))
    found = [finding for finding in inspected.blocks if finding.code.startswith("poses")]
    assert [finding.code for finding in found] == [code], [finding.message for finding in found]
    assert found[0].place == f"all trials, {channel}"
    assert option in found[0].remedy
    assert inspected.severity == "blocks"


def test_the_link_whose_heading_it_is_is_named() -> None:
    """Catches a link that is counted from the tail, or from 1, or turned by its own joint alone."""
    for number in (2, 3, 4):
        assert f"link '{filmed().fish.links[number].name}'" in poses(spoiled(None, _of_link(number)))[0].found


def test_commands_show_a_mirrored_fish() -> None:
    base = filmed("commanded", late=0.02)
    (found,) = poses(spoiled(_mirrored, _clockwise, dataset=base))
    assert found.code == "poses-mirrored"


def test_late_servos_make_no_other_link() -> None:
    """A dead time of a quarter of a beat behind waves of two frequencies. Catches shifts the other way."""
    fish = mjfish.new_fish("trout", length=0.5, mass=1.6, joints=3, height=0.09)
    model, time = Model(fish, (find("servo_delay"),)), readonly(np.arange(0.0, 8.0, 1.0 / 30.0))
    blank = (
        Sensor("position", "position", time, np.zeros((240, 2))),
        Sensor("heading", "heading", time, time[:, None]),
    )
    trials = []
    for hertz in (2.0, 2.6):
        wave = Wave(hertz, (0.1, 0.18, 0.26), (0.0, -0.8, -1.6), (0.0, 0.0, 0.0), ramp=0.5)
        trial = Trial(f"{hertz}", None, time, np.full((240, 3), np.nan), wave=wave, sensors=blank)
        read = model.predict(trial, model.values({"servo_delay.time": 0.12})).sensors
        seen = (replace(sensor, values=values) for sensor, values in zip(blank, read, strict=True))
        trials.append(replace(trial, sensors=tuple(seen)))
    assert poses(Dataset("late", fish, tuple(trials))) == []


@pytest.mark.parametrize("free", [False, True])
def test_a_heading_with_a_clock_of_its_own_is_not_held_against_the_joints(free: bool) -> None:
    """Half a beat off, the heading of a straight run swings as a mirrored one does."""
    (trial,) = mjfish.generate("pike", ["v5"], noise=NOISE, duration=7.2, observe="pose", joints="measured").trials
    place, heading = (replace(sensor, time=sensor.time - 0.12) for sensor in trial.sensors)
    late = replace(trial, sensors=(place, replace(heading, free_clock=free)))
    codes = [finding.code for finding in poses(replace(filmed(), trials=(late,)))]
    assert codes == ([] if free else ["poses-mirrored"])


def test_exchanged_markers_are_counted() -> None:
    """One for two frames, one for thirty: four jumps. Catches jumps that are looked for as spikes alone."""

    def exchanged(values: FloatArray, _: Trial) -> FloatArray:
        values[100:102] += [0.08, 0.0]
        values[200:230] += [0.0, 0.09]
        return values

    found = only(inspect(spoiled(exchanged, None, "v5")), "poses-jumps")
    assert found.severity == "suspect"
    assert found.place == "trial 'v5', position, row 101 (2.000 s) and 3 more"
    assert "exchanged markers" in found.found


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_fast_beat_in_few_frames_does_not_jump(noise: float) -> None:
    """Six frames a beat, after a rest: steps from frame to frame change by 2.5 cm. In the rest, 3 cm are found."""
    fish, time = load_fish("pike"), readonly(np.arange(0.0, 10.0, 1.0 / 30.0))
    burst = 0.7 * np.clip((time - 8.0) / 0.3, 0.0, 1.0) * np.clip((9.8 - time) / 0.1, 0.0, 1.0)
    angle = [share * burst * np.sin(10.0 * np.pi * time - k) for k, share in enumerate((0.4, 0.6, 0.8, 1.0))]
    blank = Sensor("position", "position", time, np.zeros((300, 2)))
    still = np.full((300, 3), np.nan)
    trial = Trial("b", None, time, still, joint_angle=np.transpose(angle), commanded=True, sensors=(blank,))
    (place,) = Model(fish).predict(trial, Model(fish).values()).sensors
    place = place + noise * np.random.default_rng(1).standard_normal(place.shape)
    assert np.abs(np.diff(place, n=2, axis=0)).max() > 0.025
    codes = []
    for off in (0.0, 0.03):
        place[100, 0] += off
        seen = replace(trial, sensors=(replace(blank, values=place),))
        codes.append([finding.code for finding in pose_findings(Dataset("burst", fish, (seen,)))])
    assert codes == [[], ["poses-jumps"]]


@pytest.mark.parametrize("off", [(0.03, 0.0), (0.0, -0.03)])
def test_one_frame_that_is_off_is_found(off: tuple[float, float]) -> None:
    """By less than the fish swims and swings from frame to frame."""

    def displaced(values: FloatArray, _: Trial) -> FloatArray:
        values[200] += off
        return values

    found = only(inspect(spoiled(displaced, None, "v3-t1")), "poses-jumps")
    assert found.place == "trial 'v3-t1', position, row 201 (4.000 s) and 1 more"


def test_headings_of_a_line_without_a_front_are_found() -> None:
    found = poses(spoiled(None, lambda v, _: (v - v.mean()) % np.pi, "v1"))
    assert [finding.code for finding in found] == ["poses-half-turns"]
    assert "half a turn" in found[0].found
    assert "tail to nose" in found[0].remedy


def test_missing_frames_are_counted_in_one_remark_a_run() -> None:
    """With the channels that they are missing in. Catches a remark for every channel."""
    (trial, *others) = filmed().trials
    place, heading = trial.sensors
    kept = np.ones(len(place.time), dtype=np.bool_)
    kept[[50, 51, 52, 200]] = False
    lost = f"4 of {len(kept)} samples are missing, the longest gap is 0.08 s"
    out = [f"{name}: 4 of {len(kept)} samples left out: never seen" for name in ("position", "heading")]
    fewer = kept & (np.arange(len(kept)) != 100)
    more = f"5 of {len(kept)} samples"
    holed = place.selected(kept, "never seen")
    for other, channels, told in (
        (heading, ("position",), [out[0], lost]),
        (heading.selected(kept, "never seen"), ("position", "heading"), [*out, lost]),
        (
            heading.selected(fewer, "blurred"),
            ("position", "heading"),
            [
                out[0],
                f"heading: {more} left out: blurred",
                f"position: {lost}",
                f"heading: {more} are missing, the longest gap is 0.08 s",
            ],
        ),
    ):
        dataset = replace(filmed(), trials=(replace(trial, sensors=(holed, other)), *others))
        (found,) = (finding for finding in inspect(dataset).findings if finding.code == "poses-missing")
        assert (found.severity, found.channels, found.found) == ("remark", channels, "; ".join(told))
        assert found.place == f"trial '{trial.name}', {' and '.join(channels)}"


def test_runs_of_joints_without_velocities_are_told_what_is_missing() -> None:
    """A start that the camera saw. Catches remarks that go by velocities alone."""
    base = filmed(modes=("v1",))
    late = replace(base, trials=tuple(replace(trial, from_rest=False) for trial in base.trials))
    codes = {finding.code for finding in inspect(late).findings}
    assert {"design-one-run", "design-no-turn"} <= codes
    assert "design-no-start" not in codes
    swum = replace(late, trials=tuple(_after(trial, 3.0) for trial in late.trials))
    assert "design-no-start" in {finding.code for finding in inspect(swum).findings}


def _after(trial: Trial, begin: float) -> Trial:
    rows = trial.time >= begin
    assert trial.joint_angle is not None
    return replace(
        trial, time=trial.time[rows], velocity=trial.velocity[rows], joint_angle=trial.joint_angle[rows],
        sensors=tuple(sensor.selected(sensor.time >= begin, "earlier") for sensor in trial.sensors),
    )  # fmt: skip


#: Of both foreign datasets, as a mapping file has them.
_UNITS = {"schema": 1, "kind": "poses", "fish": "-", "length_unit": "mm", "angle_unit": "deg"}


@pytest.mark.parametrize("folder", ["nothing_hidden", "current"])
def test_poses_of_a_foreign_pike_have_no_finding(foreign_poses: Path, folder: str) -> None:
    columns = {"time": "time_s", "x": "x_mm", "y": "y_mm", "yaw": "heading_deg"}
    joints = {"columns": [f"j{number}_deg" for number in range(1, 5)], "unit": "deg"}
    table = tomlfile.parse({**_UNITS, **columns, "joints": joints}, PosesMap, "test")
    files = sorted((foreign_poses / folder).glob("*.csv"))
    dataset, _ = import_mapped(files, (), table, load_fish("pike"), Path("test"))
    assert poses(dataset) == []


@pytest.mark.parametrize(("axes", "codes"), [("y_down", []), ("y_up", ["poses-mirrored"])])
def test_poses_of_a_foreign_carp_show_their_axes(foreign_carp: Path, axes: str, codes: list[str]) -> None:
    columns = {"time": "Time [s]", "x": "Head_X [mm]", "y": "Head_Y [mm]", "yaw": "Heading [deg]", "axes": axes}
    joints = {"columns": [f"cmd_{number} [deg]" for number in range(1, 4)], "unit": "deg", "are": "commanded"}
    table = tomlfile.parse({**_UNITS, **columns, "joints": joints}, PosesMap, "test")
    files = sorted(foreign_carp.glob("*.csv"))
    dataset, _ = import_mapped(files, (), table, load_fish(str(foreign_carp / "carp.toml")), Path("test"))
    assert [finding.code for finding in poses(dataset)] == codes
