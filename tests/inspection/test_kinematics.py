"""Pose against velocity, without hydrodynamics: scale, rotation, skew and offset come back with honest errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bad_data import SIGMA, good, only, remarked, spoiled, velocity, with_pose, wrong
from scipy import signal
from true_values import TRUTH

from mjfish.data import Dataset, Trial
from mjfish.fish import frames, load_fish
from mjfish.inspection import Compatibility, compatibility, inspect
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly


def _compared(dataset: Dataset) -> Compatibility:
    one = compatibility(dataset.trials)
    assert one is not None
    return one


def test_true_errors_come_back_within_four_standard_errors() -> None:
    """All at once: scale 4 %, 2 degrees, 2 cm/s in surge, 10 ms late. Catches a sign, a transpose, a missing factor."""
    angle, late = math.radians(2.0), 0.01

    def spoil(values: FloatArray) -> FloatArray:
        along, across = values[:, 0].copy(), values[:, 1].copy()
        values[:, 0] = 1.04 * (math.cos(angle) * along - math.sin(angle) * across) + 0.02
        values[:, 1] = 1.04 * (math.sin(angle) * along + math.cos(angle) * across)
        return values

    moved = spoiled(lambda t: _relabelled(t, good(), late), dataset=with_pose(good()))
    found = _compared(spoiled(velocity(spoil), dataset=moved)).translation
    for name, truth in (("scale", 1.04), ("rotation", angle), ("skew", late), ("surge_bias", 0.02), ("sway_bias", 0.0)):
        assert found[name].off(truth) < 4.0, name
        assert found[name].error < {"scale": 0.003, "rotation": 0.003, "skew": 3e-4}.get(name, 0.004)


def _relabelled(trial: Trial, dataset: Dataset, late: float) -> Trial:
    """Return a trial whose velocity at t is that of t + late, by the truth."""
    model = Model(dataset.fish)
    now, then = (model.predict(trial, model.values(TRUTH), offset=shift).velocity for shift in (0.0, late))
    return replace(trial, velocity=readonly(trial.velocity + then - now))


@pytest.mark.parametrize("phi", [0.0, 0.9])
def test_errors_are_honest(phi: float) -> None:
    """12 draws of white or slow noise: |z| as of a standard normal. Catches windows counted as independent."""
    z, slowest = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)

        def slow(values: FloatArray, rng: np.random.Generator = rng) -> FloatArray:
            white = rng.standard_normal((len(values) + 100, 3))
            return values + 2.0 * SIGMA * signal.lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], white, axis=0)[100:]

        base = spoiled(velocity(slow), dataset=good(("v1", "v5", "v3-t2"), seed))
        found = _compared(with_pose(base, seed=seed + 100))
        z += [found.translation[name].off(0.0) for name in ("rotation", "skew", "sway_bias")]
        z.append(found.rotation["skew"].off(0.0))
        slowest.append(found.rotation["bias"].off(0.0))
    spread = math.sqrt(float(np.mean(np.square(z))))
    assert 0.6 < spread < 1.6, spread
    assert max(z) < 5.0
    assert math.sqrt(float(np.mean(np.square(slowest)))) < 2.3


@pytest.mark.parametrize(
    ("change", "causes", "words"),
    [
        (lambda v: v * [1.05, 1.05, 1.0], ("velocity_scale",), "1.05"),
        (lambda v: v * [1.0, 1.0, 1.03], (), "1.03"),
        (lambda v: v + np.array([0.0, 0.03, 0.0]), ("ambient_current", "sheared_current"), "0.0"),
    ],
)
def test_a_disagreement_names_its_cause(change: object, causes: tuple[str, ...], words: str) -> None:
    """Catches the water blamed for the camera, and the camera's scale for the yaw rate, which no scale touches."""
    found = only(inspect(spoiled(velocity(change), dataset=with_pose(good()))), "compatibility")  # type: ignore[arg-type]
    assert found.cannot_tell == causes
    assert words in found.found


def test_a_misaligned_camera_is_named_in_degrees() -> None:
    """Catches radians, and the mirrored sense."""
    angle = math.radians(3.0)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])

    def spoil(values: FloatArray) -> FloatArray:
        values[:, :2] = values[:, :2] @ turn
        return values

    found = only(inspect(spoiled(velocity(spoil), dataset=with_pose(good()))), "compatibility")
    assert found.cannot_tell == ("frame_misalignment",)
    assert "3.0" in found.found


def test_a_pose_in_millimetres_blocks() -> None:
    """Catches a unit that is called a calibration."""
    base = with_pose(good())
    spoil = replace(
        base,
        trials=tuple(replace(t, pose=readonly(t.pose * [1e3, 1e3, 1.0])) for t in base.trials if t.pose is not None),
    )
    found = only(inspect(spoil), "compatibility")
    assert found.severity == "blocks"
    assert "unit" in found.remedy


def test_velocities_made_from_the_pose_say_nothing() -> None:
    """Savitzky-Golay, whatever the scale. Catches agreement that is taken for calibration."""

    def derived(trial: Trial) -> Trial:
        assert trial.pose is not None
        rate = signal.savgol_filter(1.1 * trial.pose, 9, 2, deriv=1, delta=0.02, axis=0)
        body = frames.to_body(rate[:, :2], trial.pose[:, 2])
        return replace(trial, velocity=readonly(np.column_stack([body, rate[:, 2]])))

    found = inspect(spoiled(derived, dataset=with_pose(good())))
    assert wrong(found) == []
    assert "velocity_scale" in remarked(found, "compatibility")[0].cannot_tell


def _central_differences(step: float) -> Callable[[Trial], Trial]:
    """Return a change of trials: pose and velocity every `step` s, the velocity by central differences."""
    rng = np.random.default_rng(7)

    def change(trial: Trial) -> Trial:
        model = Model(load_fish("pike"))
        time = np.arange(step, float(trial.time[-1]), step)
        rollout = model.predict(trial, model.values(TRUTH)).rollout
        ahead, now, behind = (rollout.at(time + shift)[:, 3:6] for shift in (step, 0.0, -step))
        rate = (ahead - behind) / (2.0 * step)
        body = frames.to_body(rate[:, :2], now[:, 2])
        pose = now + rng.standard_normal(now.shape) * [0.001, 0.001, 0.003]
        velocity = np.column_stack([body, rate[:, 2]]) + rng.standard_normal(now.shape) * 0.3 * SIGMA
        return replace(trial, time=readonly(time), pose=readonly(pose), velocity=readonly(velocity))

    return change


def test_central_differences_are_no_scale_of_the_camera() -> None:
    """They lose sin(w h) / (w h), in the yaw rate too. Catches a scale, or the gain of a gyro, blamed for it."""
    dataset = spoiled(_central_differences(1.0 / 30.0))
    compared = _compared(dataset)
    assert compared.differences == (1, 1)
    found = inspect(dataset)
    assert [finding.code for finding in found.findings if finding.code.startswith("compatibility")] == [
        "compatibility-differentiated"
    ]
    assert compared.loss == pytest.approx(1.0 - np.sinc(2.0 * 26.0 / (2.0 * math.pi) / 30.0), abs=1e-6)


def test_a_scale_below_one_is_not_taken_for_central_differences() -> None:
    """3 % at every frequency. Catches central differences that explain anything below 1."""
    scaled = spoiled(velocity(lambda v: v * [0.97, 0.97, 1.0]), dataset=with_pose(good()))
    assert _compared(scaled).differences == (0, 0)
    assert only(inspect(scaled), "compatibility-scale").cannot_tell == ("velocity_scale",)


def test_yaw_alone_is_enough_for_the_yaw_rate() -> None:
    """X and y NaN. Catches a NaN that spreads."""
    base = with_pose(good())
    blind = replace(
        base,
        trials=tuple(
            replace(t, pose=readonly(t.pose * [np.nan, np.nan, 1.0])) for t in base.trials if t.pose is not None
        ),
    )
    found = _compared(blind)
    assert found.translation == {}
    assert found.rotation["scale"].off(1.0) < 4.0
    assert wrong(inspect(blind)) == []
