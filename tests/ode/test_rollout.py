"""Rollouts: their start, their end, reading them at any time."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from joint_motions import still, waving
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.drive.cpg import DriveSegment
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish

JUMP = (DriveSegment(0.0, 18.0, (0.0,) * 4), DriveSegment(0.5, 30.0, (0.0, 1.0, 1.5, 2.0)))


def test_starts_at_rest_or_at_the_velocity_given_in_the_forward_frame(pike: Fish) -> None:
    motion = waving(0.5, 100)
    assert not np.any(ode.simulate(pike, motion).state[0, 0])
    rollout = ode.simulate(pike, motion, velocity=np.array([0.5, -0.1, 0.3]))
    assert rollout.state[0, 0, :3] == pytest.approx([0.5, -0.1, 0.3])
    gained = rollout.state[-1, 1, 3]
    assert gained == pytest.approx(0.25, abs=0.1)  # forward is +x
    assert rollout.derivative[0, 0, 3:6] == pytest.approx([0.5, -0.1, 0.3])


def test_a_gliding_stretched_fish_slows_down_by_its_skin_friction_alone(pike: Fish) -> None:
    """Closed form: m u' = -k u^2, u = u_0 / (1 + u_0 k t / m)."""
    rollout = ode.simulate(pike, still(2.0, 400, (0.0,) * 4), velocity=np.array([0.8, 0.0, 0.0]))
    wetted = 0.0702359775 + 0.0158873875 + 0.0133173182 + 0.0107639050 + 0.0174422782
    rate = 0.5 * 1000.0 * 0.02 * wetted / sum(link.mass for link in pike.links)
    time = np.linspace(0.0, 2.0, 21)
    found = rollout.at(time)
    np.testing.assert_allclose(found[:, 0], 0.8 / (1.0 + 0.8 * rate * time), atol=1e-8)
    np.testing.assert_allclose(found[:, 3], np.log1p(0.8 * rate * time) / rate, atol=1e-8)
    assert not np.any(found[:, [1, 2, 4, 5]])


def test_values_replace_coefficients_as_a_changed_fish_would(pike: Fish) -> None:
    values = dict(zip(COEFFICIENTS, (0.5, 0.6, 0.7, 1.0, 1.1, 1.2, 0.01, 0.011, 0.012), strict=True))
    motion = waving(1.0, 200)
    changed = ode.simulate(pike.with_values(values), motion).state
    assert np.array_equal(ode.simulate(pike, motion, values=values).state, changed)
    for name in values:  # each of the nine is wired to something
        others = {key: value for key, value in values.items() if key != name}
        assert not np.array_equal(ode.simulate(pike, motion, values=others).state, changed)


def test_a_misspelt_coefficient_is_refused(pike: Fish) -> None:
    with pytest.raises(UnknownNameError, match=r"c_d\.hed.*known: c_d\.body"):
        ode.simulate(pike, waving(0.1, 10), values={"c_d.hed": 2.0})


def test_a_motion_of_another_fish_is_refused(pike: Fish) -> None:
    with pytest.raises(InputError, match="3 joints, pike has 4"):
        ode.simulate(pike, still(0.1, 10, (0.0, 0.0, 0.0)))


def test_reading_between_steps_is_of_fourth_order_and_hits_the_nodes(pike: Fish) -> None:
    time = np.linspace(0.0, 1.0, 333)
    exact = ode.simulate(pike, waving(1.0, 6400)).at(time)
    errors = [np.max(np.abs(ode.simulate(pike, waving(1.0, n)).at(time) - exact)) for n in (200, 400, 800)]
    assert errors[0] / errors[2] > 2.0 ** (2 * 3.2)
    rollout = ode.simulate(pike, waving(1.0, 200))
    np.testing.assert_allclose(rollout.at(rollout.time[:-1]), rollout.state[:, 0], atol=1e-12)
    np.testing.assert_allclose(rollout.at(rollout.time[-1:]), rollout.state[-1:, 1], atol=1e-12)


def test_at_a_jump_the_value_after_it_is_read(pike: Fish) -> None:
    rollout = ode.simulate(pike, cpg.joint_motion(pike.cpg, JUMP, 1.0, 0.005))
    after = int(np.searchsorted(rollout.time, 0.5 - 1e-9))
    assert np.max(np.abs(rollout.state[after, 0, :3] - rollout.state[after - 1, 1, :3])) > 0.1
    assert rollout.at(np.array([0.5]))[0] == pytest.approx(rollout.state[after, 0])
    assert rollout.at(np.array([0.5 - 1e-6]))[0] == pytest.approx(rollout.state[after - 1, 1], abs=1e-3)


def test_before_the_start_the_first_value_is_read_and_behind_the_end_none(pike: Fish) -> None:
    rollout = ode.simulate(pike, waving(0.5, 100), velocity=np.array([0.1, 0.2, 0.3]))
    found = rollout.at(np.array([-1.0, 0.0, 0.5, 0.6]))
    assert np.array_equal(found[0], found[1])
    assert np.all(np.isfinite(found[:3]))
    assert np.all(np.isnan(found[3]))


def test_divergence_is_a_status_that_names_time_and_parameters(pike: Fish) -> None:
    """Not an exception, and nothing that was computed before is lost."""
    motion = cpg.joint_motion(pike.cpg, modes.drive("v7"), 4.0, 0.02)
    rollout = ode.simulate(pike, motion, values={"c_d.tail": 20.0})
    assert rollout.status == "diverged"
    assert rollout.message.startswith("diverged at ")
    for part in (f"{rollout.time[-1]:.3f} s", "c_d.tail = 20", "c_f.tail = 0.02", "c_m.head = 0.01"):
        assert part in rollout.message
    assert 1 <= len(rollout.state) < len(motion.time) - 1
    assert np.all(np.isfinite(rollout.state))
    assert np.all(np.isnan(rollout.at(np.array([rollout.time[-1] + 0.1]))))


def test_divergence_in_the_first_step_is_reported_too(pike: Fish) -> None:
    rollout = ode.simulate(pike, waving(0.5, 5), velocity=np.array([np.nan, 0.0, 0.0]))
    assert rollout.status == "diverged"
    assert "0.000 s" in rollout.message


def test_a_good_rollout_says_so(pike: Fish) -> None:
    rollout = ode.simulate(pike, waving(0.5, 100))
    assert (rollout.status, rollout.message) == ("ok", "")
    assert rollout.time[-1] == pytest.approx(0.5)


def test_the_same_run_twice_is_bitwise_the_same(pike: Fish) -> None:
    motion = cpg.joint_motion(pike.cpg, JUMP, 1.0, 0.005)
    assert np.array_equal(ode.simulate(pike, motion).state, ode.simulate(pike, motion).state)


def test_nothing_keeps_a_motion_alive_behind_the_callers_back(pike: Fish) -> None:
    """A fit makes thousands of motions; each is a megabyte."""
    motion = waving(0.5, 100)
    seen = weakref.ref(motion)
    assert ode.simulate(pike, motion).status == "ok"
    del motion
    gc.collect()
    assert seen() is None
