"""Errors of joint angles in the loop of their smoother, against the covariance of the whole run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mjfish
from mjfish.data import Sensor
from mjfish.drive.measured import Smoothing, smoothing
from mjfish.estimation import sensor_noise
from mjfish.estimation.sensor_noise import HEAD, JOINT, Along, JointErrors
from mjfish.noise.kalman import filtered_states, whitened
from mjfish.numerics.arrays import FloatArray

STEP, SAMPLES, SIGMA = 0.04, 40, 0.01


def _joint(seed: int) -> Smoothing:
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(SAMPLES)
    return smoothing(time, 0.4 * np.sin(6.0 * time) + SIGMA * rng.standard_normal(SAMPLES))


def _along(joints: int) -> Along:
    """Return a made-up linear motion whose jacobians change with time."""
    rng, time = np.random.default_rng(3), np.linspace(0.0, STEP * SAMPLES, 400)
    a = -np.diag([1.0, 2.0, 4.0]) + 0.3 * rng.standard_normal((3, 3))
    swing = np.sin(3.0 * time)[:, None, None]
    by_input = 0.5 * rng.standard_normal((3, 3, joints)) * np.array([1.0, 0.3, 0.02])[:, None]
    state = np.zeros((len(time), HEAD))
    state[:, 0], state[:, 5] = 0.3, 0.5 * np.sin(2.0 * time)
    by_state, by_joints = a * (1.0 + 0.3 * swing), by_input[None] * (1.0 + 0.5 * swing[..., None])
    return Along(time, state, lambda steps: (by_state[steps], by_joints[steps]))


def _errors(joints: int) -> JointErrors:
    trial = mjfish.generate("pike", ["v1"], duration=STEP * (SAMPLES - 1), rate=1.0 / STEP).trials[0]
    assert len(trial.time) == SAMPLES
    return JointErrors.of(trial, [_joint(seed) for seed in range(joints)], _along(joints))


def _steps(errors: JointErrors) -> tuple[FloatArray, FloatArray]:
    """Return all transitions and drives (n, d, d)."""
    _, transitions, drives = zip(*errors.stretches(), strict=True)
    return np.concatenate(transitions), np.concatenate(drives)


def _covariance(errors: JointErrors) -> FloatArray:
    """Return the covariance (n d, n d) of the states of a whole run, from transitions and drives alone."""
    transition, drive = _steps(errors)
    n, d = len(errors.time), len(errors.start)
    whole = np.zeros((n, d, n, d))
    whole[0, :, 0] = errors.start
    for k in range(n - 1):
        whole[k + 1, :, : k + 1] = np.einsum("ij,jnk->ink", transition[k], whole[k, :, : k + 1])
        whole[: k + 1, :, k + 1] = whole[k + 1, :, : k + 1].transpose(1, 2, 0)
        whole[k + 1, :, k + 1] = transition[k] @ whole[k, :, k] @ transition[k].T + drive[k]
    return whole.reshape(n * d, n * d)


def test_the_error_of_an_angle_is_that_of_its_spline() -> None:
    """Given later samples it has the posterior variance sigma^2 H of the smoothing spline ([Wahba1990], ch. 1.5)."""
    joint, errors = _joint(0), _errors(1)
    whole = _covariance(errors).reshape(SAMPLES, HEAD + JOINT, SAMPLES, HEAD + JOINT)
    found = whole[:, HEAD, :, HEAD]
    hat = np.stack([joint.of(column[:, None])(STEP * np.arange(SAMPLES))[:, 0] for column in np.eye(SAMPLES)], axis=1)
    np.testing.assert_allclose(found, joint.sigma**2 * hat, atol=2e-3 * joint.sigma**2)


@pytest.mark.parametrize("stretch", [4096, 7], ids=["at once", "in stretches"])
def test_whitening_is_that_of_the_covariance_of_the_whole_run(stretch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """X' (R + H P H')^-1 x, sensors that lack samples among them; however many samples are held at once."""
    monkeypatch.setattr(sensor_noise, "_STRETCH", stretch)
    rng, errors = np.random.default_rng(5), _errors(2)
    rows = (np.arange(SAMPLES), np.arange(0, SAMPLES, 3))
    readings = tuple(
        rng.standard_normal((len(own), channels, len(errors.start))) for own, channels in zip(rows, (2, 1), strict=True)
    )
    counted = np.zeros((SAMPLES, 3), dtype=np.bool_)
    counted[rows[0], :2], counted[rows[1], 2] = True, True
    stacked = errors.stacked(rows, readings)
    filter_, alone = errors.filter(stacked, np.array([0.01, 0.02, 0.05]), counted)
    every = np.zeros((SAMPLES, 3, 1))
    every[rows[0], :2, 0], every[rows[1], 2, 0] = rng.standard_normal((SAMPLES, 2)), rng.standard_normal(len(rows[1]))
    white = whitened(filter_, np.ones(SAMPLES, dtype=np.bool_), every)
    reading = np.zeros((SAMPLES, 3, SAMPLES, len(errors.start)))
    for at, own, first in zip(rows, readings, (0, 2), strict=True):
        for k, row in enumerate(at):
            reading[row, first : first + own.shape[1], row] = own[k]
    flat = reading.reshape(3 * SAMPLES, -1)
    noise = np.ones((SAMPLES, 3))
    noise[rows[0], :2], noise[rows[1], 2] = np.array([0.01, 0.02]) ** 2, 0.05**2
    dense = np.diag(noise.ravel()) + flat @ _covariance(errors) @ flat.T
    x = every.ravel()
    assert float(np.sum(white**2)) == pytest.approx(float(x @ np.linalg.solve(dense, x)), rel=1e-6)
    np.testing.assert_allclose(
        alone[:, :2].ravel(),
        np.diag(dense - np.diag(noise.ravel())).reshape(SAMPLES, 3)[:, :2].ravel(),
        rtol=1e-8,
    )


def test_later_samples_are_foretold_as_by_the_covariance_of_the_whole_run() -> None:
    """Of the first half of the samples, x: C_ba (C_aa + R)^-1 x, with C of the readings."""
    rng, errors, half = np.random.default_rng(6), _errors(2), SAMPLES // 2
    reading = rng.standard_normal((SAMPLES, 3, len(errors.start)))
    counted = np.repeat(np.arange(SAMPLES)[:, None] < half, 3, axis=1)
    rows = (np.arange(SAMPLES),)
    sigma = np.array([0.01, 0.02, 0.05])
    filter_, _ = errors.filter(errors.stacked(rows, (reading,)), sigma, counted)
    series = rng.standard_normal((SAMPLES, 3))
    states = filtered_states(filter_, series)
    whole = np.zeros((SAMPLES, 3, SAMPLES, len(errors.start)))
    whole[np.arange(SAMPLES), :, np.arange(SAMPLES)] = reading
    flat = whole.reshape(3 * SAMPLES, -1)
    c = flat @ _covariance(errors) @ flat.T
    before = c[: 3 * half, : 3 * half] + np.diag(np.tile(sigma**2, half))
    expected = c[3 * half :, : 3 * half] @ np.linalg.solve(before, series[:half].ravel())
    found = np.einsum("kcd,kd->kc", reading[half:], states[half:]).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_sensor_may_go_on_behind_the_last_joint_angle() -> None:
    """There the intensity is that of the last interval."""
    trial = mjfish.generate("pike", ["v1"], duration=STEP * (SAMPLES - 1), rate=1.0 / STEP).trials[0]
    late = np.append(trial.time, trial.time[-1] + 0.5 * STEP)
    sensor = Sensor("heading", "heading", late, np.zeros((len(late), 1)))
    errors = JointErrors.of(replace(trial, sensors=(sensor,)), [_joint(0)], _along(1))
    assert len(errors.time) == SAMPLES + 1
    assert errors.intensity[0, -1] == errors.intensity[0, -2]


def _driven(k: int, errors: JointErrors, begun: FloatArray, end: FloatArray) -> FloatArray:
    """Return the head (6,) a step behind `begun` (9,), by small ones; the joint goes on a quintic to `end` (3,)."""
    along, time = _along(1), np.linspace(errors.time[k], errors.time[k + 1], 2001)
    h, v, way = time[-1] - time[0], begun[:3], begun[3:HEAD]
    scale = h ** np.arange(3.0)
    rows = np.array([[0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 1, 0], [0, 0, 0, 2, 0, 0]], dtype=float)
    last = np.array([[1, 1, 1, 1, 1, 1], [5, 4, 3, 2, 1, 0], [20, 12, 6, 2, 0, 0]], dtype=float)
    poly = np.linalg.solve(np.concatenate([rows, last]), np.concatenate([begun[HEAD:] * scale, end * scale]))
    s = (time - time[0]) / h
    push = np.stack([np.polyval(np.polyder(poly, order), s) / h**order for order in range(3)], axis=1)
    for i in range(len(time) - 1):
        at = np.interp(time[i] + 0.5 * (time[1] - time[0]), along.time, np.arange(len(along.time)))
        low, share = int(at), at - int(at)
        by_state, by_joints = along.jacobians(slice(low, low + 2))
        a = (1 - share) * by_state[0] + share * by_state[1]
        b = (1 - share) * by_joints[0, ..., 0] + share * by_joints[1, ..., 0]
        surge, sway, yaw = (1 - share) * along.state[low, [0, 1, 5]] + share * along.state[low + 1, [0, 1, 5]]
        seen = v + np.array([-way[2] * sway, way[2] * surge, 0.0])
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        way = way + (time[1] - time[0]) * (turn @ seen)
        v = v + (time[1] - time[0]) * (a @ v + b @ (0.5 * (push[i] + push[i + 1])))
    return np.concatenate([v, way])


def test_the_head_follows_the_equation_between_samples() -> None:
    """It obeys dv' = A dv + B (d, d', d''); its way turns with the heading; d is a quintic from sample to sample.

    Its end is what is expected of it (transition) and what comes in by chance, which moves the head, too (drive).
    """
    errors, k = _errors(1), 7
    transition, drive = (every[k] for every in _steps(errors))
    begun = np.array([0.0, 0.02, 0.1, 0.0, 0.0, 0.03, 0.01, -0.2, 3.0])
    expected = _driven(k, errors, begun, transition[HEAD:, HEAD:] @ begun[HEAD:])
    np.testing.assert_allclose((transition @ begun)[:HEAD], expected, rtol=2e-3, atol=2e-6)
    chance = np.array([0.002, 0.3, -20.0])
    moved = drive[:HEAD, HEAD:] @ np.linalg.solve(drive[HEAD:, HEAD:], chance)
    pushed = _driven(k, errors, np.zeros(HEAD + JOINT), chance)
    np.testing.assert_allclose(moved, pushed, rtol=5e-3, atol=2e-6)
    own = drive[:HEAD, HEAD:] @ np.linalg.solve(drive[HEAD:, HEAD:], drive[HEAD:, :HEAD])
    np.testing.assert_allclose(drive[:HEAD, :HEAD], own, atol=1e-9 * np.abs(own).max())
