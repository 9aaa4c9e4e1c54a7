"""A flexible tail in MuJoCo: a passive hinge behind the driven joint, and the same swimming as in the ODE."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mjfish import simulation as crosscheck
from mjfish.drive import cpg, modes
from mjfish.fish import Fish
from mjfish.mujoco import Trim, export, mjcf, simulate
from studies import engines

_SOFT = {"tail_compliance": 0.3, "tail_damping": 0.03, "tail_hardening": 20.0}


@pytest.fixture
def soft(pike: Fish) -> Fish:
    """A pike whose tail gives way, ever less with its load."""
    return pike.model_copy(update=_SOFT)


def test_the_hinge_has_the_stiffness_and_the_damping(soft: Fish, pike: Fish) -> None:
    model, rigid = mjcf.swimmer(soft).model, mjcf.swimmer(pike).model
    hinge = model.joint("deflection")
    assert model.nv == rigid.nv + 1
    assert hinge.dofadr[0] == model.nv - 1
    assert model.dof_bodyid[-1] == model.body("tail").id
    np.testing.assert_allclose(np.ravel(hinge.stiffness)[0], 1.0 / 0.3)
    np.testing.assert_allclose(model.jnt_stiffnesspoly[hinge.id], [0.0, 20.0 / 0.3])
    np.testing.assert_allclose(np.ravel(hinge.damping)[0], 0.03)


@pytest.mark.parametrize(("quadratic", "hardening"), [(20.0, 0.0), (-6.0, 15.0)])
def test_both_engines_bend_it_by_the_square_of_the_deflection_too(
    pike: Fish, monkeypatch: pytest.MonkeyPatch, quadratic: float, hardening: float
) -> None:
    """To either side alike. Catches an even spring, one that acts on one side only, and one of the wrong sign."""
    monkeypatch.setattr(engines, "ENGINES", engines.ENGINES[:3])
    soft = pike.model_copy(update={**_SOFT, "tail_quadratic": quadratic, "tail_hardening": hardening})
    rows = list(engines.sweep(soft, cases=(engines.CASES[2],), duration=5.6))
    assert [row.status for row in rows] == ["agrees"] * 3
    assert max(row.to_ode for row in rows) < 1e-5
    motion = cpg.joint_motion(pike.cpg, modes.drive("v3"), 3.0, 0.001)
    cubic = soft.model_copy(update={"tail_quadratic": 0.0})
    assert np.abs(simulate(soft, motion).velocity - simulate(cubic, motion).velocity).max() > 0.02


def test_both_engines_swim_alike_with_it(soft: Fish, pike: Fish) -> None:
    """Servos move the joints, the tail bends behind them; a turn with its step of the drive."""
    found = crosscheck.check(soft, "v3-t2", duration=6.2, halvings=1)
    assert found.passed, found.message
    assert found.orders[0] > 3.5
    motion = cpg.joint_motion(pike.cpg, modes.drive("v3"), 3.0, 0.001)
    rigid, bent = (simulate(fish, motion).velocity for fish in (pike, soft))
    assert np.abs(rigid - bent).max() > 0.1


def test_both_engines_swim_alike_with_it_on_prescribed_joints(soft: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over the jump of the joints' rate. Catches a tail that does not take up its share of the impulse."""
    monkeypatch.setattr(engines, "ENGINES", engines.ENGINES[:3])
    rows = list(engines.sweep(soft, cases=(engines.CASES[2],), duration=5.6))
    assert [row.status for row in rows] == ["agrees"] * 3
    assert max(row.to_ode for row in rows) < 1e-5


def test_an_exported_fish_has_it_too(soft: Fish) -> None:
    """To the last bit, and in the free fish as well."""
    soft = soft.model_copy(update={"tail_quadratic": 7.0})
    for free in (None, Trim()):
        read = mujoco.MjModel.from_xml_string(export.text(soft, free=free))
        made = (mjcf.swimmer(soft) if free is None else mjcf.swimmer(soft, free=Trim())).model
        for field in (
            "jnt_stiffness",
            "dof_damping",
            "dof_armature",
            "body_mass",
            "body_inertia",
            "jnt_stiffnesspoly",
            "tendon_stiffnesspoly",
            "tendon_lengthspring",
        ):
            np.testing.assert_array_equal(getattr(read, field), getattr(made, field), err_msg=field)
        assert made.jnt_stiffness.max() == 1.0 / 0.3


def test_a_free_fish_with_a_flexible_tail_swims(soft: Fish) -> None:
    """Catches joints read from where the deflection is."""
    soft = soft.model_copy(update={"tail_hardening": 0.0})  # with it the servos are further behind
    motion = cpg.joint_motion(soft.cpg, modes.drive("v1"), 1.0, 0.001)
    run = simulate(soft, motion, free=Trim())
    assert run.status == "ok"
    planar_run = simulate(soft, motion)
    np.testing.assert_allclose(run.joint_angle, planar_run.joint_angle, atol=0.05)
    assert np.abs(planar_run.joint_angle - motion.angle_at(planar_run.time)).max() < 0.15
