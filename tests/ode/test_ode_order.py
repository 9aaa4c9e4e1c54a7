"""Order of the integrator, by halving the step four times."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import waving

from mjfish import ode
from mjfish.drive import cpg
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray

HALVINGS = 4


def _order(errors: list[float]) -> FloatArray:
    """Return the observed order of each halving."""
    assert min(errors) > 1e-13  # below this it is rounding that is measured
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def test_runge_kutta_converges_at_order_four_where_the_force_is_smooth(pike: Fish) -> None:
    """Forward speed keeps friction of one sign; drag across, whose sign changes along the body, is switched off."""
    values = {"c_d.head": 0.0, "c_d.body": 0.0, "c_d.tail": 0.0, "c_m.head": 0.5, "c_m.body": 0.5, "c_m.tail": 0.5}

    def end(steps: int) -> FloatArray:
        motion = waving(1.0, steps)
        rollout = ode.simulate(pike, motion, values=values, velocity=np.array([1.0, 0.0, 0.0]))
        assert rollout.state[:, :, 0].min() > 0.3
        return rollout.state[-1, 1, :6]

    exact = end(40 * 2 ** (HALVINGS + 3))
    errors = [float(np.max(np.abs(end(40 * 2**k) - exact))) for k in range(HALVINGS + 1)]
    assert _order(errors) == pytest.approx(4.0, abs=0.15)


def test_sign_changes_of_drag_along_the_body_keep_the_order_above_three(pike: Fish) -> None:
    """Q |q| is only once differentiable; where its root leaves a link in the middle of a step, a step's order drops.

    Integrated over the strips the kink is smoothed, and the overall order stays near four.
    """

    def run(steps: int) -> FloatArray:
        rollout = ode.simulate(pike, waving(2.0, steps))
        return rollout.at(np.linspace(0.1, 2.0, 20))[:, :3]

    exact = run(400 * 2 ** (HALVINGS + 3))
    errors = [float(np.sqrt(np.mean((run(400 * 2**k) - exact) ** 2))) for k in range(HALVINGS + 1)]
    assert np.mean(_order(errors)) > 3.5
    assert np.min(_order(errors)) > 3.0


def test_jumps_of_the_joint_rates_do_not_cost_order(pike: Fish) -> None:
    """Steps end at the jump and momentum is carried over it exactly. A step across it would be of first order."""
    drive = (DriveSegment(0.0, 18.0, (0.0,) * 4), DriveSegment(0.37, 26.0, (0.0, 0.5, 1.0, 1.5)))

    def end(step: float) -> FloatArray:
        return ode.simulate(pike, cpg.joint_motion(pike.cpg, drive, 1.0, step)).state[-1, 1, :6]

    exact = end(0.005 / 2 ** (HALVINGS + 3))
    errors = [float(np.max(np.abs(end(0.005 / 2**k) - exact))) for k in range(HALVINGS + 1)]
    assert np.mean(_order(errors)) > 3.5
