"""The learned curve of the joints over their command."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error
from scipy import integrate
from scipy.interpolate import BSpline

from mjfish.data import Trial
from mjfish.drive.motion import JointMotion
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray

CURVE = find("servo_curve")
SHORTS = [p.short for p in CURVE.parameters]
KNOTS = np.array([0.1, -0.2, 0.4, 0.1, 0.9, 2.0, 3.0])


def _values(knots: FloatArray) -> dict[str, float]:
    return dict(zip(SHORTS, map(float, knots), strict=True))


def _moved(command: FloatArray, knots: FloatArray, rate: float = 0.0, bend: float = 0.0) -> JointMotion:
    """Return what two joints do at commands (n,), the second at minus the first, with these rates and accelerations."""
    angle = np.broadcast_to(np.stack([command, -command], axis=1)[:, None], (len(command), 3, 2))
    still = np.ones_like(angle)
    motion = JointMotion(np.arange(len(command) + 1.0), angle, rate * still, bend * still)
    return CURVE.drive(motion, _values(knots))


def _slope(command: FloatArray, knots: FloatArray) -> FloatArray:
    """Return exp(-g) by scipy: knots ten degrees apart, mirrored at both ends and level beyond."""
    count = len(knots)
    g = BSpline(np.arange(-3.0, count + 3.0), np.concatenate([knots[1:2], knots, knots[-2:-1]]), 3)
    return np.asarray(np.exp(-g(np.minimum(np.abs(command) / np.radians(10.0), count - 1.0))))


def test_the_angle_is_the_integral_of_its_slope(pike: Fish) -> None:
    """Against quadrature, up to beyond the last knot, and odd."""
    command = np.radians([0.0, 3.0, 10.0, 27.0, 44.0, 59.9, 60.0, 75.0])
    found = _moved(command, KNOTS).angle[:, 1]
    marks = list(np.radians(np.arange(10.0, 61.0, 10.0)))
    expected = [integrate.quad(_slope, 0.0, c, args=(KNOTS,), points=marks, epsabs=1e-13)[0] for c in command]
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-8, atol=1e-12)
    assert np.array_equal(found[:, 0], -found[:, 1])
    assert pike.joints == 4


def test_rates_and_accelerations_follow_by_the_chain_rule() -> None:
    """Of a command that swings through zero and beyond the last knot, against differences of the angle."""
    h = 1e-4
    time = np.linspace(0.0, 1.0, 41)

    def at(shift: float) -> JointMotion:
        phase = 9.0 * (time + shift)
        command = 1.2 * np.sin(phase)
        rate, bend = 9.0 * 1.2 * np.cos(phase), -81.0 * command
        angle, turn, change = (np.broadcast_to(x[:, None, None], (41, 3, 1)) for x in (command, rate, bend))
        return CURVE.drive(JointMotion(np.arange(42.0), angle, turn, change), _values(KNOTS))

    here, ahead, back = at(0.0), at(h), at(-h)
    ends = [0, 2]  # in mid-step they carry the change over the step
    rate, acceleration = (ahead.angle - back.angle) / (2.0 * h), (ahead.rate - back.rate) / (2.0 * h)
    np.testing.assert_allclose(here.rate[:, ends], rate[:, ends], atol=1e-4)
    np.testing.assert_allclose(here.acceleration[:, ends], acceleration[:, ends], atol=2e-2)
    assert np.abs(here.acceleration).max() > 50.0


def test_no_joint_turns_back_whatever_the_knots() -> None:
    """Random knots within their bounds, or on them."""
    rng = np.random.default_rng(4)
    low, high = (np.array([getattr(p, end) for p in CURVE.parameters]) for end in ("low", "high"))
    command = np.linspace(-1.5, 1.5, 401)
    for draw in range(50):
        share = rng.uniform(size=len(SHORTS))
        knots = low + (np.round(share) if draw % 2 else share) * (high - low)
        assert np.all(np.diff(_moved(command, knots).angle[:, 0, 0]) > 0.0)


@pytest.mark.parametrize(("psi", "softness"), [(0.5, 0.5), (1.5, 0.5), (1.5, 0.17)])
def test_it_begins_like_the_saturation(psi: float, softness: float) -> None:
    """Within 4 % of the largest angle up to 60 degrees; at another formula's numbers nothing is known."""
    values = {"psi": psi, "softness": softness}
    like = CURVE.like("servo_saturation", values)
    command = np.radians(np.linspace(0.0, 60.0, 13))
    found = _moved(command, np.array([like[short] for short in SHORTS])).angle[:, 0, 0]
    h = (psi * command**2) ** (0.5 / softness)
    expected = command * (1.0 + h) ** (-softness)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=0.04 * expected.max())
    assert CURVE.like("another", {}) == {}


@pytest.mark.parametrize("short", SHORTS)
def test_its_derivatives(pike: Fish, turning: Trial, short: str) -> None:
    """Of a turn, whose last joint is told 50 degrees."""
    assert derivative_error(pike, turning, CURVE, _values(0.3 * KNOTS), short) < 1e-6
