"""What sensors read of a run: kinematics against second differences, derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mjfish
from mjfish.data import Sensor, Trial
from mjfish.data.sensor import CHANNELS_OF, Kind
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS, to_world
from mjfish.model import Model, with_sensors
from mjfish.model.model import LEAD
from mjfish.numerics.arrays import FloatArray

POSE = np.array([0.3, -0.2, 0.7])
LATE = {"imu": 0.0013, "tag": -0.002}


def _sensor(name: str, kind: Kind, time: FloatArray, link: int = 0, station: float = 0.0) -> Sensor:
    return Sensor(name, kind, time, np.zeros((len(time), len(CHANNELS_OF[kind]))), link, station)


def _trial(fish: Fish, *sensors: Sensor, mode: str = "v1", duration: float = 2.5) -> Trial:
    (trial,) = mjfish.generate(fish, [mode], duration=duration).trials
    return replace(trial, sensors=sensors)


def _swim(fish: Fish, step: float = 1e-3) -> tuple[FloatArray, Model, Trial]:
    """Return times within a run, and it with a point and an imu 8 cm behind the nose, one near the tail, a heading."""
    time = 1.9 + step * np.arange(400)
    sensors = (
        _sensor("tag", "position", time, 0, 0.08),
        _sensor("imu", "imu", time, 0, 0.08),
        _sensor("compass", "heading", time),
        _sensor("tail", "position", time, len(fish.links) - 1, 0.05),
    )
    return time, Model(fish, step=step), _trial(fish, *sensors)


def test_an_imu_reads_the_second_derivative_of_its_place_and_the_first_of_the_heading(pike: Fish) -> None:
    time, model, trial = _swim(pike)
    tag, imu, compass, _ = model.predict(trial, model.values(), pose=POSE).sensors
    h = float(time[1] - time[0])
    in_world = (tag[2:] - 2.0 * tag[1:-1] + tag[:-2]) / h**2
    assert to_world(imu[1:-1, 1:], compass[1:-1, 0]) == pytest.approx(in_world, abs=2e-3 * np.abs(in_world).max())
    assert imu[1:-1, 0] == pytest.approx((compass[2:, 0] - compass[:-2, 0]) / (2.0 * h), rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("compliance", [0.0, 2.0])
def test_a_point_on_the_tail_is_as_far_from_the_nose_as_the_links_and_joints_say(pike: Fish, compliance: float) -> None:
    """A flexible tail is bent on by its deflection, which is a state of the run."""
    time, model, trial = _swim(pike)
    model = model.extended(find("tail_compliance"))
    values = model.values({"tail_compliance.compliance": compliance})
    run, predicted = model.prepare(trial, values), model.predict(trial, values, pose=POSE)
    angle = run.motion.angle_at(time)
    deflection = predicted.rollout.at(time)[:, 6]
    assert (np.abs(deflection).max() > 1e-3) == (compliance > 0.0)
    angle[:, -1] += deflection
    chain = 0.05 * np.exp(1j * angle[:, -1]) + pike.links[-2].length  # complex numbers, from the tail to the head
    for link, joint in zip(pike.links[-3::-1], angle.T[-2::-1], strict=True):
        chain = chain * np.exp(1j * joint) + link.length
    nose = predicted.sensors[0] + 0.08 * _unit(predicted.sensors[2][:, 0])
    chain = chain * np.exp(1j * predicted.sensors[2][:, 0])
    assert predicted.sensors[3] == pytest.approx(nose - np.stack([chain.real, chain.imag], axis=1), abs=1e-12)


def _unit(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_the_pose_at_the_start_moves_and_turns_the_track_and_nothing_else(pike: Fish) -> None:
    _, model, trial = _swim(pike)
    here, there = (model.predict(trial, model.values(), pose=pose) for pose in (np.zeros(3), POSE))
    assert there.sensors[0] == pytest.approx(POSE[:2] + to_world(here.sensors[0], POSE[2]), abs=1e-12)
    assert there.sensors[2] == pytest.approx(here.sensors[2] + POSE[2], abs=1e-12)
    assert np.array_equal(there.velocity, here.velocity)


NAMES = (
    "c_d.tail", "c_m.body", "c_f.head", "start.x", "start.y", "start.yaw", "start.surge", "start.yaw_rate",
    "imu.clock_offset", "tag.clock_offset",
)  # fmt: skip
WITH_EFFECTS = (
    ("servo_lag", "time_constant", 0.03), ("ambient_current", "x", 0.05), ("tail_compliance", "compliance", 2.0),
    ("section_height", None, 1.05), ("time_offset", "offset", 0.004), ("clock_rate", "error", 0.004),
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_of_every_sensor_by_coefficients_starts_and_clocks(pike: Fish, name: str) -> None:
    model = Model(pike)
    _check(model, _five(pike), model.values(), name)


def test_behind_the_end_of_a_run_nothing_moves_with_the_clock(pike: Fish) -> None:
    """Its last state is read there."""
    trial = _five(pike)
    late = {sensor.name: 0.5 for sensor in trial.sensors}
    names = [sensor.clock for sensor in trial.sensors]
    _, found = with_sensors(Model(pike), trial, Model(pike).values(), names, sensor_offsets=late)
    for k, (sensor, block) in enumerate(zip(trial.sensors, found, strict=True)):
        behind = sensor.time + 0.5 > trial.time[-1] + LEAD + 0.01
        assert behind.any()
        assert not block[behind, :, k].any(), sensor.name
        assert np.abs(block[~behind, :, k]).max() > 1e-3


@pytest.mark.parametrize(("effect", "short", "value"), WITH_EFFECTS)
def test_derivatives_of_every_sensor_by_causes_and_beside_them(
    pike: Fish, effect: str, short: str | None, value: float
) -> None:
    one = find(effect)
    p = Model(pike, (one,)).effects[0].parameters[0] if short is None else one.declaration(short)
    model = Model(pike, (one,))
    values = model.values({p.name: min(value, 0.5 * (p.default + p.high))})
    for name in (p.name, "start.yaw", "c_d.tail"):
        _check(model, _five(pike), values, name)


def test_derivatives_by_a_length_move_the_point_on_the_tail(pike: Fish) -> None:
    table = pike.model_dump(by_alias=True)
    table["links"] = [dict(link) for link in table["links"]]
    table["links"][0]["length"] = {"value": table["links"][0]["length"], "sd": 0.01}
    fish = Fish.model_validate(table)
    model = Model(fish)
    (name,) = [p.name for p in fish.numbers]
    _check(model, _five(fish), model.values(), name)


def _five(fish: Fish) -> Trial:
    time = np.linspace(0.0131, 2.4, 41)
    last = len(fish.links) - 1
    return _trial(
        fish,
        _sensor("tag", "position", time, 0, 0.05),
        _sensor("tail", "position", time, last, 0.05),
        _sensor("compass", "heading", time),
        _sensor("imu", "imu", time, 0, 0.1),
        _sensor("gyro", "gyro", time),
    )


def _check(model: Model, trial: Trial, values: dict[str, float], name: str) -> None:
    given = {"velocity": np.zeros(3), "pose": POSE, "sensor_offsets": LATE}
    velocity, sensors = with_sensors(model, trial, values, [name], **given)
    assert velocity.shape == (len(trial.time), 3, 1)
    scale = 0.005 if name.startswith(("imu", "tag", "time_offset")) else 0.02
    h = 0.01 * scale

    def at(by: float) -> tuple[FloatArray, ...]:
        owner, _, short = name.rpartition(".")
        moved = dict(given)
        if owner == "start":
            key, row = ("pose", ("x", "y", "yaw")) if short in ("x", "y", "yaw") else ("velocity", CHANNELS)
            moved[key] = given[key] + by * np.eye(3)[row.index(short)]
        elif short == "clock_offset":
            moved["sensor_offsets"] = {**LATE, owner: LATE[owner] + by}
        own = {**values, name: values[name] + by} if name in values else values
        return model.predict(trial, own, **moved).sensors

    sides = {k: (at(k * h), at(-k * h)) for k in (1, 2, 3)}
    for i, (sensor, found) in enumerate(zip(trial.sensors, sensors, strict=True)):
        weights = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
        expected = sum(w * (sides[k][0][i] - sides[k][1][i]) for k, w in weights) / h
        size = np.abs(expected).max(axis=0) + 1e-6
        # Where a difference goes over an end of a step, the rate of the acceleration jumps there.
        tolerance = 3e-4 if name.endswith("clock_offset") else 2e-6
        assert np.all(np.abs(found[:, :, 0] - expected) < tolerance * size + 1e-9), (name, sensor.name)
