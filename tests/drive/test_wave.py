"""A wave as a drive: the formula, exact rates, a ramp without steps."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.drive.wave import Wave, joint_motion
from mjfish.errors import InputError

WAVE = Wave(1.2, (0.2, 0.3), (0.5, -0.4), (0.1, -0.05))


def test_angles_are_those_of_the_formula() -> None:
    """A phase that leads instead of lags, or a frequency in rad/s, shows here."""
    motion = joint_motion(WAVE, 0.5, 2.0, 0.01)
    expected = np.array(WAVE.bias) + np.array(WAVE.amplitude) * np.sin(
        2 * np.pi * 1.2 * motion.time[:-1, None] + np.array(WAVE.phase)
    )
    np.testing.assert_allclose(motion.angle[:, 0], expected, atol=1e-14)
    assert motion.time[0] == 0.5
    assert motion.time[-1] == 2.0


@pytest.mark.parametrize("ramp", [0.0, 0.7])
def test_rates_and_accelerations_are_the_derivatives(ramp: float) -> None:
    """The product rule of ramp and swing: a missing factor of 2 shows at fourth order."""
    wave = Wave(WAVE.frequency, WAVE.amplitude, WAVE.phase, WAVE.bias, ramp=ramp)
    motion = joint_motion(wave, 0.0, 2.0, 0.01)
    half = 0.5 * np.diff(motion.time)[:, None]
    by_simpson = (motion.rate[:, 0] + 4 * motion.rate[:, 1] + motion.rate[:, 2]) * half / 3
    np.testing.assert_allclose(motion.angle[:, 2] - motion.angle[:, 0], by_simpson, atol=1e-9)
    by_simpson = (motion.acceleration[:, 0] + 4 * motion.acceleration[:, 1] + motion.acceleration[:, 2]) * half / 3
    np.testing.assert_allclose(motion.rate[:, 2] - motion.rate[:, 0], by_simpson, atol=1e-6)


def test_a_ramp_starts_at_rest_and_ends_in_the_wave() -> None:
    ramped = Wave(WAVE.frequency, WAVE.amplitude, WAVE.phase, WAVE.bias, ramp=0.7)
    motion, plain = joint_motion(ramped, 0.0, 2.0, 0.01), joint_motion(WAVE, 0.0, 2.0, 0.01)
    for values in (motion.angle, motion.rate, motion.acceleration):
        np.testing.assert_allclose(values[0, 0], 0.0, atol=1e-14)
    assert 0.7 in motion.time  # where the third derivative steps
    np.testing.assert_allclose(motion.angle[-50:], plain.angle[-50:], atol=1e-12)


def test_a_moved_wave_has_its_own_clock() -> None:
    moved = WAVE.moved(frequency=0.1, phase=0.2)
    assert moved.frequency == pytest.approx(1.3)
    assert moved.phase == pytest.approx((0.7, -0.2))
    assert (moved.amplitude, moved.bias, moved.joints) == (WAVE.amplitude, WAVE.bias, 2)


def test_a_wave_with_a_phase_missing_is_refused() -> None:
    with pytest.raises(InputError, match="2 amplitudes, 1 phases and 2 biases"):
        joint_motion(Wave(1.0, (0.1, 0.1), (0.0,), (0.0, 0.0)), 0.0, 1.0, 0.01)
