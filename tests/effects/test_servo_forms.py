"""Servos that follow late: formulas, and the learned form that has them all in it."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.drive.motion import JointMotion
from mjfish.effects import catalogue, find
from mjfish.effects.commanded import SHORTEST, filtered, limited
from mjfish.fish import Fish

LEARNED = find("servo_dynamics")
NOTHING = {p.short: p.default for p in LEARNED.parameters}


@pytest.fixture(scope="module")
def command(pike: Fish, turning: Trial) -> JointMotion:
    """A start, and a step of the drive at 1.5 s."""
    return cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)


def _same(one: JointMotion, other: JointMotion) -> bool:
    parts = ("time", "angle", "rate", "acceleration")
    return all(getattr(one, part).tobytes() == getattr(other, part).tobytes() for part in parts)


@pytest.mark.parametrize("name", ["servo_second_order", "servo_delay", "servo_dynamics"])
def test_at_its_null_the_motion_is_the_command_itself(command: JointMotion, name: str) -> None:
    effect = find(name)
    for shape in ("default", "low", "high"):
        values = {p.short: getattr(p, shape) if p.shape else p.default for p in effect.parameters}
        assert effect.drive(command, values) is command


def test_a_second_order_servo_is_the_filter(command: JointMotion) -> None:
    got = find("servo_second_order").drive(command, {"time": 0.03, "damping": 0.5})
    assert _same(got, filtered(command, 0.03, 0.5))
    assert not _same(got, command)


def test_a_dead_time_is_a_shift_of_the_command(command: JointMotion) -> None:
    """theta(t) = c(t - T) once the filter that rounds the start has died away, 2 ms of T being the filter's.

    Behind the dead time the filter 1 / (1 + T D)^2 differs from a delay by 2 T by T^2 c'', and by less beyond it.
    """
    limit = 1.5 * SHORTEST**2 * np.abs(command.acceleration).max()
    for time in (0.0475, 0.1):
        got = find("servo_delay").drive(command, {"time": time})
        ends = got.time[1:]
        away = (ends > time + 0.02) & ((ends < 1.5) | (ends > 1.52 + time))
        asked = command.angle_at(ends[away] - time)
        np.testing.assert_allclose(got.angle[away, 2], asked, rtol=0.0, atol=limit)
        assert np.all(got.angle[:-1][ends[1:] < time - 2.0 * SHORTEST] == command.angle[0, 0])


def test_a_dead_time_below_that_of_its_filter_is_none(command: JointMotion) -> None:
    assert find("servo_delay").drive(command, {"time": 1.9 * SHORTEST}) is command
    assert find("servo_delay").drive(command, {"time": 2.1 * SHORTEST}) is not command


def test_a_limited_lag_keeps_its_limit(command: JointMotion) -> None:
    got = find("servo_limited_lag").drive(command, {"slowness": 0.1, "time": 0.01})
    assert np.abs(command.rate).max() > 10.0
    assert np.abs(got.rate[:, ::2]).max() < 10.0 * (1.0 + 1e-12)
    assert np.abs(got.rate[:, ::2]).max() > 9.9


def test_a_limited_lag_whose_limit_is_not_met_is_a_lag(command: JointMotion) -> None:
    """Runge-Kutta steps of half the time constant against the exact solution: to 1e-4 of the angles."""
    got = find("servo_limited_lag").drive(command, {"slowness": 1e-3, "time": 0.01})
    lag = find("servo_lag").drive(command, {"time_constant": 0.01})
    np.testing.assert_allclose(got.angle, lag.angle, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(got.rate[:, 2], lag.rate[:, 2], rtol=0.0, atol=1e-2)
    assert np.abs(got.angle - command.angle).max() > 0.05


def test_the_learned_form_with_time_and_damping_alone_is_the_second_order_servo(command: JointMotion) -> None:
    for own in ({"time": 0.03, "damping": 0.5}, {"time": SHORTEST, "damping": 2.0}):
        assert _same(LEARNED.drive(command, {**NOTHING, **own}), find("servo_second_order").drive(command, own))


def test_the_learned_form_with_a_dead_time_alone_is_the_dead_time(command: JointMotion) -> None:
    """The shortest filter stays in both; critically damped it is one and the same, 2 ms of its formula's dead time."""
    learned = LEARNED.drive(command, {**NOTHING, "delay": 0.04 - 2.0 * SHORTEST, "damping": 1.0})
    assert _same(learned, find("servo_delay").drive(command, {"time": 0.04}))


def test_the_learned_form_is_the_limit_and_then_the_filter_behind_a_dead_time(command: JointMotion) -> None:
    learned = {"slowness": 0.1, "catch_up": 150.0, "time": 0.01, "damping": 0.6, "delay": 0.02}
    assert _same(LEARNED.drive(command, learned), filtered(limited(command, 0.1, 150.0), 0.01, 0.6, 0.02))


#: Sizes of all formulas that the learned form is to be like.
FORMULAS = {
    "servo_lag": {"time_constant": 0.03},
    "servo_second_order": {"time": 0.03, "damping": 0.5},
    "servo_delay": {"time": 0.03},
    "servo_rate_limit": {"slowness": 0.1},
    "servo_limited_lag": {"slowness": 0.1, "time": 0.01},
}


def test_the_learned_form_knows_all_formulas_of_its_mechanism() -> None:
    known = catalogue().values()
    assert {e.name for e in known if e.mechanism == LEARNED.mechanism and not e.learned} == set(FORMULAS)


@pytest.mark.parametrize("name", FORMULAS)
def test_the_learned_form_can_be_like_each_of_them(command: JointMotion, name: str) -> None:
    """Its fit starts there: it has at most a fifth, by rms, of what the formula does to the command left."""
    own = FORMULAS[name]
    like = LEARNED.like(name, own)
    assert all(LEARNED.declaration(short).check(value) == value for short, value in like.items())
    formula, learned = find(name).drive(command, own), LEARNED.drive(command, {**NOTHING, **like})
    apart, acts = (np.sqrt(np.mean((formula.angle - other.angle) ** 2)) for other in (learned, command))
    assert apart < 0.2 * acts


def test_a_servo_stands_still_behind_a_command_that_does(command: JointMotion) -> None:
    """Unit static gain, whatever the numbers."""
    angle = np.broadcast_to(command.angle[100, 0], command.angle.shape)
    held = JointMotion(command.time, angle, np.zeros_like(angle), np.zeros_like(angle))
    for effect in (LEARNED, find("servo_second_order"), find("servo_delay"), find("servo_limited_lag")):
        got = effect.drive(held, {p.short: p.default + 4.0 * p.scale for p in effect.parameters})
        np.testing.assert_allclose(got.angle, held.angle, rtol=0.0, atol=1e-13)
