"""Measured joint angles that jump between two samples are found, with their time and what to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_data import good

from mjfish.data import Trial
from mjfish.inspection import inspect
from mjfish.inspection.samples import interpolated, unresolved
from mjfish.numerics.arrays import FloatArray, readonly

TIME = np.arange(0.0, 8.0, 0.02)
FREQUENCY = 2.0


def _beat(time: FloatArray, bias: float = 0.0) -> FloatArray:
    """Return angles (n, 2) of a steady beat [rad]."""
    phase = 2.0 * np.pi * FREQUENCY * time[:, None] + np.array([0.0, -1.2])
    return np.asarray(np.array([0.3, 0.5]) * np.sin(phase) + bias)


def _trial(angle: FloatArray, noise: float = 0.003) -> Trial:
    """Return a trial with these angles (n, 2), measured with white noise [rad]."""
    angle = angle + np.random.default_rng(2).normal(0.0, noise, angle.shape)
    return Trial("run", None, readonly(TIME), readonly(np.zeros((len(TIME), 3))), joint_angle=readonly(angle))


def test_a_start_that_jumps_is_found_with_its_time() -> None:
    """The beat begins at 0.5 s at full rate and angle. Catches a test that needs samples of a beat to either side."""
    (found,) = unresolved(_trial(np.where(TIME[:, None] < 0.5, 0.0, _beat(TIME))))
    assert (found.code, found.severity, found.trials) == ("joints-unresolved", "suspect", ("run",))
    assert "joint_2, near 0.49 s" in found.message
    assert "keep its rows from 1.02 to 7.98 s; or record the joint angles faster" in found.remedy


def test_a_step_of_the_drive_cuts_the_run_in_two() -> None:
    """The middle of the beat moves by 0.2 rad at 4 s. Catches a cut that keeps one part."""
    (found,) = unresolved(_trial(np.where(TIME[:, None] < 4.0, _beat(TIME), _beat(TIME, 0.2))))
    assert "near 3.99 s" in found.place
    assert "from 0 to 3.92 s and from 4.52 to 7.98 s, each as a run of its own" in found.remedy


def test_what_is_cut_as_the_remedy_says_has_no_jump() -> None:
    """Catches a cut too close to the jump."""
    trial = _trial(np.where(TIME[:, None] < 4.0, _beat(TIME), _beat(TIME, 0.2)))
    for kept in (TIME <= 3.92 + 1e-9, TIME >= 4.52 - 1e-9):
        assert trial.joint_angle is not None
        part = replace(trial, time=readonly(TIME[kept]), joint_angle=readonly(trial.joint_angle[kept]))
        assert list(unresolved(part)) == []


@pytest.mark.parametrize("noise", [0.0, 1e-5, 0.003, 0.02])
def test_a_beat_that_starts_smoothly_is_no_jump(noise: float) -> None:
    """A ramp of half a second, whatever the noise. Catches the third derivative of a ramp taken for a jump."""
    share = np.clip(TIME / 0.5, 0.0, 1.0)
    ramp = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    assert list(unresolved(_trial(ramp[:, None] * _beat(TIME), noise))) == []


def test_kinks_in_every_beat_are_no_jump() -> None:
    """Servos at their limit. Catches a remedy to cut what belongs to the beat."""
    assert list(unresolved(_trial(np.clip(_beat(TIME), -0.1, 0.1), 0.001))) == []


def test_commanded_angles_may_jump() -> None:
    """They are held until the next. Catches a test that asks a command to be smooth."""
    angle = np.where(TIME[:, None] < 0.5, 0.0, _beat(TIME))
    assert list(unresolved(replace(_trial(angle), commanded=True))) == []


def test_velocities_at_a_jump_are_no_outliers() -> None:
    """The nose jumps with the joints. Catches a remedy that removes samples for what the joints did."""
    (first, *_) = good(("v1", "v3")).trials
    later = (np.arange(len(first.time)) >= 200)[:, None]
    angle = _beat(first.time) + 0.2 * later + np.random.default_rng(2).normal(0.0, 0.003, (len(later), 2))
    smooth = replace(first, drive=(), joint_angle=readonly(angle - 0.2 * later))
    for trial, judged in ((smooth, True), (replace(smooth, joint_angle=readonly(angle)), False)):
        line = interpolated(trial)
        assert line is not None
        assert bool(np.any(line.rows == 200)) == judged
        assert np.any(line.rows == 100)


def test_inspect_tells_of_the_jumps_of_every_trial() -> None:
    """Catches a finding that inspection does not ask for."""
    base = good(("v1", "v3"))
    angle = np.where(np.arange(361)[:, None] < 200, 0.0, 0.2 + _beat(0.02 * np.arange(361)))[:, [0, 1, 0, 1]]
    angle = angle + np.random.default_rng(2).normal(0.0, 0.003, angle.shape)
    trials = tuple(replace(trial, drive=(), joint_angle=readonly(angle)) for trial in base.trials)
    codes = [finding.code for finding in inspect(replace(base, trials=trials)).findings]
    assert codes.count("joints-unresolved") == 2
