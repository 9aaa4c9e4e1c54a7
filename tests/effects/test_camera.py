"""Causes of the camera on places and headings, against the velocities that they make of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mjfish
from mjfish.data import Sensor, Trial
from mjfish.effects import catalogue
from mjfish.model import Model
from mjfish.model.sensitivity import with_sensors

CASES = {
    "velocity_scale": {"velocity_scale.error": 0.05},
    "frame_misalignment": {"frame_misalignment.angle": 0.1},
    "marker_offset": {"marker_offset.along": -0.08, "marker_offset.across": 0.02},
    "time_offset": {"time_offset.offset": 0.03},
    "clock_rate": {"clock_rate.error": 0.01},
    "ambient_current": {"ambient_current.x": 0.05, "ambient_current.y": -0.03, "ambient_current.held": 0.5},
    "roll": {"roll.height": 0.004, "roll.frequency": 9.0, "roll.damping": 0.15},
    "lens_distortion": {"lens_distortion.curvature": 0.03, "lens_distortion.x": 0.4, "lens_distortion.y": -0.3},
    "camera_tilt": {
        "camera_tilt.tilt_x": 0.03, "camera_tilt.tilt_y": -0.02, "camera_tilt.x": 0.4, "camera_tilt.y": -0.3,
    },
}  # fmt: skip


def _filmed(rate: float) -> Trial:
    return mjfish.generate("pike", ["v1-t1"], duration=6.4, rate=rate, observe="pose", places=[(0.3, 0.2, 0.5)]).trials[
        0
    ]


@pytest.mark.parametrize("name", [name for name in CASES if name not in ("lens_distortion", "camera_tilt", "roll")])
def test_places_and_headings_give_the_velocities_that_the_camera_reads(name: str) -> None:
    """Differentiated and turned by the heading that was seen. Catches a sign, a clock, a cause that moves one alone."""
    trial, model = _filmed(250.0), Model(mjfish.load_fish("pike"), (catalogue()[name],))
    predicted = model.predict(trial, model.values(CASES[name]), pose=np.array([0.3, 0.2, 0.5]))
    place, heading = (CubicSpline(trial.time, values) for values in predicted.sensors)
    yaw, rate = heading(trial.time)[:, 0], place(trial.time, 1)
    surge = np.cos(yaw) * rate[:, 0] + np.sin(yaw) * rate[:, 1]
    sway = np.cos(yaw) * rate[:, 1] - np.sin(yaw) * rate[:, 0]
    found = np.stack([surge, sway, heading(trial.time, 1)[:, 0]], axis=1)
    smooth = (trial.time > 0.1) & (trial.time < 6.2) & (np.abs(trial.time - 5.2) > 0.1)
    np.testing.assert_allclose(found[smooth], predicted.velocity[smooth], atol=2e-3)


@pytest.mark.parametrize("acting", [True, False], ids=["acting", "at its null"])
@pytest.mark.parametrize("name", CASES)
def test_what_the_camera_sees_is_derived_exactly(name: str, acting: bool) -> None:
    """By the parameters of the cause, of the water and of the start. Catches a hook that derivatives pass by."""
    trial, effect = _filmed(50.0), catalogue()[name]
    trial = mjfish.data.Trial(**{**vars(trial), "sensors": (
        *trial.sensors, Sensor("tail", "position", trial.time, np.zeros((len(trial.time), 2)), link=3, station=0.02)
    )})  # fmt: skip
    model = Model(mjfish.load_fish("pike"), (effect,))
    values, pose = model.values(CASES[name] if acting else {}), np.array([0.3, 0.2, 0.5])
    names = ["c_d.tail", "start.x", "start.yaw", *(p.name for p in effect.parameters if acting or not p.shape)]
    _, found = with_sensors(model, trial, values, names, pose=pose)
    for k, parameter in enumerate(names):
        h = 1e-5
        ends = []
        for sign in (1.0, -1.0):
            moved, start = dict(values), pose.copy()
            if parameter.startswith("start."):
                start[("x", "y", "yaw").index(parameter.partition(".")[2])] += sign * h
            else:
                moved[parameter] += sign * h
            ends.append(model.predict(trial, moved, pose=start).sensors)
        for own, ahead, behind in zip(found, *ends, strict=True):
            exact = (ahead - behind) / (2.0 * h)
            away = np.abs(trial.time - 5.2) > 0.05
            np.testing.assert_allclose(own[away, :, k], exact[away], atol=2e-3 * max(np.abs(exact).max(), 1e-3))


@pytest.mark.parametrize(
    ("name", "values"), [("lens_distortion", {"curvature": 0.05}), ("camera_tilt", {"tilt_x": 0.05, "tilt_y": -0.08})]
)
def test_a_heading_turns_with_the_picture(name: str, values: dict[str, float]) -> None:
    """Two points of a short line, as the camera sees them, give the heading that is read."""
    cause, values = catalogue()[name], {**values, "x": 0.2, "y": -0.4}
    trial = _filmed(50.0)
    place, heading = np.array([[1.0, 0.7], [-0.8, 0.3]]), np.array([0.4, -2.0])
    ahead = 1e-6 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    time = np.zeros(2)
    near, turned = cause.camera(time, place, heading, values, trial)
    far, _ = cause.camera(time, place + ahead, heading, values, trial)
    np.testing.assert_allclose(np.arctan2(*(far - near).T[::-1]), turned, atol=1e-6)
    assert np.abs(turned - heading).max() > 0.01


def test_a_tilted_camera_sees_what_a_pinhole_sees() -> None:
    """It is 2 m above the plane and looks 5 degrees away from straight down; in the middle the scale is right."""
    height, tilt = 2.0, np.radians(5.0)
    place = np.array([[0.0, 0.0], [1.0, 0.7], [-0.8, 0.3], [0.5, -0.9]])
    sight = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    up = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    middle = height * np.tan(tilt)  # where the line of sight meets the plane
    rays = np.column_stack([place[:, 0], place[:, 1] + middle, np.full(len(place), -height)])
    depth = rays @ sight
    seen = np.column_stack([rays[:, 0], rays @ up]) / depth[:, None] * (height / np.cos(tilt))
    seen[:, 1] /= np.cos(tilt)  # and so is the scale along y
    values = {"tilt_x": 0.0, "tilt_y": np.sin(tilt) * np.cos(tilt) / height, "x": 0.0, "y": 0.0}
    cause, nothing = catalogue()["camera_tilt"], np.zeros(len(place))
    found, _ = cause.camera(nothing, place, nothing, values, _filmed(50.0))
    np.testing.assert_allclose(found, seen, atol=1e-12)
