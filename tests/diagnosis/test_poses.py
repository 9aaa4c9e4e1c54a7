"""Diagnoses of places and headings, with joint angles that were measured or commanded: an effect is found, or none."""

from __future__ import annotations

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset
from mjfish.diagnosis import Diagnosis
from mjfish.effects import find

CURRENT = {"ambient_current.x": 0.03, "ambient_current.y": -0.04}
#: Of x, y [m], heading [rad], and of measured joints [rad].
NOISE, JOINTS = (1e-3, 1e-3, 0.008), 0.004


def _pool(joints: str, values: dict[str, float] | None = None, seed: int = 0) -> Dataset:
    return mjfish.generate(
        "pike", ["v1", "v3-t1", "v5", "v1-t2"], values=values, noise=NOISE, seed=seed, held_out=["v5"], duration=6.5,
        observe="pose", joints=joints, joint_noise=JOINTS if joints == "measured" else 0.0,
        places=[(0.5, 0.0, 0.3), (0.0, 0.4, 2.0), (0.0, 0.0, -2.5), (-0.3, 0.1, 1.0)],
    )  # fmt: skip


@pytest.fixture(scope="module")
def quiet() -> Diagnosis:
    few = ("ambient_current", "servo_lag", "joint_zero_offset", "inertia_error", "lens_distortion", "munk_moment")
    return mjfish.diagnose(_pool("measured", seed=4), effects={name: find(name) for name in few})


def test_nothing_is_named_where_nothing_is_hidden(quiet: Diagnosis) -> None:
    """Errors of the joints reach the path; catches one that smooths, or takes the angles for exact."""
    assert quiet.verdict == "nothing_wrong", quiet.message
    for name, estimate in quiet.extended.items():
        truth = mjfish.load_fish("pike").values[name]
        reach = 0.5 * (estimate.high - estimate.low) / 1.96
        assert abs(estimate.estimate - truth) < 4.0 * reach, name


def test_the_noise_of_the_camera_is_read_from_the_residual(quiet: Diagnosis) -> None:
    assert quiet.problem is not None
    for sensor, sigma in (("position", NOISE[:2]), ("heading", NOISE[2:])):
        np.testing.assert_allclose(quiet.problem.sensor_sigma[sensor], sigma, rtol=0.1)


def test_the_report_says_that_errors_of_the_joints_are_allowed_for(quiet: Diagnosis) -> None:
    told = "errors of the recorded joint angles in v1, v3-t1, v1-t2 matter: they are counted as noise"
    assert told in quiet.remarks


@pytest.mark.slow
def test_a_current_is_named_with_its_speed_and_lowers_the_error_of_the_path() -> None:
    found = mjfish.diagnose(_pool("commanded", CURRENT, seed=5))
    assert [cause.name for cause in found.causes] == ["ambient_current"], found.message
    for short in ("x", "y"):
        estimate = found.causes[0].parameters[short]
        assert estimate.estimate == pytest.approx(CURRENT[f"ambient_current.{short}"], abs=2e-3)
    assert found.gain is not None
    assert found.gain.relative_reduction > 0.5
    assert set(found.gain.nominal) == {"position x", "position y", "heading yaw", "pooled"}
    before, after = found.gain.mean_speed_error
    assert after < before
    held = next(overlay for overlay in found.overlays if overlay.held_out)
    left = [np.sqrt(np.mean((held.sensors[0].sensor.values - own) ** 2)) for own in
            (held.sensors[0].nominal, held.sensors[0].extended)]  # fmt: skip
    assert left[1] < 0.5 * left[0]


@pytest.mark.slow
def test_a_tilted_camera_is_named() -> None:
    tilt = {"camera_tilt.tilt_x": 0.03, "camera_tilt.tilt_y": -0.02, "camera_tilt.x": 0.3, "camera_tilt.y": -0.2}
    found = mjfish.diagnose(_pool("commanded", tilt, seed=7))
    assert [cause.name for cause in found.causes] == ["camera_tilt"], found.message
    for short in ("tilt_x", "tilt_y"):
        assert found.causes[0].parameters[short].estimate == pytest.approx(tilt[f"camera_tilt.{short}"], abs=3e-3)


@pytest.mark.slow
def test_a_lens_that_bends_the_picture_is_named_with_its_centre() -> None:
    lens = {"lens_distortion.curvature": 0.04, "lens_distortion.x": 0.3, "lens_distortion.y": -0.2}
    found = mjfish.diagnose(_pool("commanded", lens, seed=6))
    assert [cause.name for cause in found.causes] == ["lens_distortion"], found.message
    for short, reach in (("curvature", 2e-3), ("x", 0.02), ("y", 0.02)):
        assert found.causes[0].parameters[short].estimate == pytest.approx(lens[f"lens_distortion.{short}"], abs=reach)
