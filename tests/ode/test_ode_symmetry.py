"""Symmetries that the nominal model has exactly, and that diagnosis relies on."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import waving

from mjfish import ode
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.load import ANSWER, load_rows
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.equation import STATES, Joints, derivative
from mjfish.ode.rollout import system_of

BIAS = np.array([0.1, -0.2, 0.3, 0.1])
MIRROR = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def _states(fish: Fish, motion: JointMotion, velocity: tuple[float, ...] | None = None) -> FloatArray:
    rollout = ode.simulate(fish, motion, velocity=None if velocity is None else np.array(velocity))
    return rollout.state[:, :, :6]


@pytest.mark.parametrize("munk", [0.0, 1.0])
def test_a_mirrored_drive_swims_the_mirrored_path(pike: Fish, munk: float) -> None:
    """Catches any sign slip between port and starboard: sway, yaw and y change sign, surge and x do not."""
    fish = pike.model_copy(update={"munk_moment": munk})
    port = _states(fish, waving(2.0, 400, bias=BIAS), (0.1, 0.05, -0.3))
    starboard = _states(fish, waving(2.0, 400, bias=BIAS, sign=-1.0), (0.1, -0.05, 0.3))
    assert np.ptp(port[..., 1]) > 0.1
    np.testing.assert_allclose(starboard, port * MIRROR, rtol=0.0, atol=1e-12)


def test_heading_does_not_matter_to_the_water(pike: Fish) -> None:
    """Turned in the world by any angle the body rates are bitwise the same, and the path is turned with it."""
    motion = waving(1.0, 10)
    rates = []
    for yaw in (0.0, 0.7, -2.5):
        state = np.array([-0.4, 0.1, 0.8, 3.0, -2.0, yaw, 0.0, 0.0])
        out = np.empty(STATES)
        angle, rate, acceleration = motion.angle[3, 1], motion.rate[3, 1], motion.acceleration[3, 1]
        joints = Joints(np.cos(angle), np.sin(angle), rate, acceleration, angle[-1])
        derivative(system_of(pike, None, "corrected", load_rows([])), joints, state, np.zeros(ANSWER), out)
        turned = complex(out[3], out[4]) * np.exp(-1j * yaw)
        rates.append([*out[:3], turned.real, turned.imag])
    assert rates[1][:3] == rates[0][:3] == rates[2][:3]
    np.testing.assert_allclose(rates, [rates[0]] * 3, rtol=0.0, atol=1e-15)
    assert rates[0][3:] == pytest.approx([-0.4, 0.1])


@pytest.mark.parametrize("factor", [0.5, 1.7])
def test_speed_scales_with_beat_frequency(pike: Fish, factor: float) -> None:
    """V(t; f) = f U(f t): every force is quadratic in speed. Catches a term that is not, e.g. linear damping."""
    slow = waving(2.0, 400, bias=BIAS)
    fast = JointMotion(slow.time / factor, slow.angle, slow.rate * factor, slow.acceleration * factor**2)
    expected = _states(pike, slow)
    expected[..., :3] *= factor
    np.testing.assert_allclose(_states(pike, fast), expected, rtol=0.0, atol=1e-12)


def test_straight_swimming_is_symmetric_under_half_a_beat_and_a_mirror(pike: Fish) -> None:
    """Glide reflection of the settled swim: surge repeats after half a beat, sway and yaw rate change sign."""
    beat, beats = 100, 60
    velocity = _states(pike, waving(beats / 1.5, beats * beat))[:, 0, :3]
    last = velocity[-beat // 2 :]
    before = velocity[-beat : -beat // 2]
    assert np.ptp(last[:, 1]) > 0.05
    np.testing.assert_allclose(last, before * MIRROR[:3], rtol=0.0, atol=1e-7)


def test_a_turning_drive_breaks_the_glide_reflection(pike: Fish) -> None:
    """The same measure must see an asymmetric fish, or it would measure nothing."""
    beat, beats = 100, 60
    velocity = _states(pike, waving(beats / 1.5, beats * beat, bias=BIAS))[:, 0, :3]
    difference = velocity[-beat // 2 :] - velocity[-beat : -beat // 2] * MIRROR[:3]
    assert np.max(np.abs(difference[:, 2])) > 0.1
