"""Every engine on prescribed joints: agrees where it is right, is seen where it is not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjfish import simulation as crosscheck
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.mujoco import prescribed
from mjfish.simulation import cross_check as module

_STRAIGHT = crosscheck.CASES[0]
_TURN = crosscheck.CASES[2]


def test_every_engine_agrees_at_the_order_of_its_integrator(pike: Fish) -> None:
    """A term that is missing, lagged, or doubled in one coupling or integrator leaves a difference that stays."""
    rows = list(crosscheck.check_all(pike, cases=(_STRAIGHT,), duration=1.5))
    assert [row.status for row in rows] == ["agrees"] * len(module.ENGINES)
    fourth = [row for row in rows if row.claimed == 4]
    assert all(row.to_ode < 1e-6 and row.order > 3.5 for row in fourth)
    assert all(abs(row.order - 1.0) < 0.2 for row in rows if row.claimed == 1)
    assert all(math.isnan(row.to_reference) for row in rows)


@pytest.mark.parametrize("case", crosscheck.CASES, ids=lambda case: case.name)
def test_mujoco_reproduces_the_reference_trajectories(
    case: crosscheck.Case, reference: Path, pike: Fish, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Start-up and the jump of the joints' rate included: the trajectories share no equation with either engine."""
    monkeypatch.setattr(module, "ENGINES", module.ENGINES[:3])
    rows = list(crosscheck.check_all(pike, cases=(case,), reference=reference))
    assert [row.status for row in rows] == ["agrees"] * 3
    assert max(row.to_reference for row in rows) < 1e-5  # worst seen: 5.0e-6, the trajectory's own


def test_momentum_of_the_root_is_kept_where_the_rates_of_the_joints_jump(pike: Fish) -> None:
    """Without the impulse of the joints the turn would start a tenth of a metre a second off."""
    rows = [row for row in crosscheck.check_all(pike, cases=(_TURN,), duration=5.4) if row.integrator == "RK4"]
    assert all(row.to_ode < 1e-6 for row in rows)


def test_an_engine_with_another_water_is_seen(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """One coefficient one percent off in MuJoCo alone."""
    honest = prescribed.simulate

    def slip(fish: Fish, motion: Any, *, values: dict[str, float], **options: Any) -> prescribed.Prescribed:
        return honest(fish, motion, values={**values, "c_d.tail": 1.01 * values["c_d.tail"]}, **options)

    monkeypatch.setattr(prescribed, "simulate", slip)
    rows = list(crosscheck.check_all(pike, cases=(_STRAIGHT,), duration=1.0))
    assert {row.status for row in rows if row.engine == "ODE"} == {"agrees"}
    assert {row.status for row in rows if row.engine == "MuJoCo"} == {"disagrees"}


def test_a_run_that_diverges_is_a_row(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = prescribed.simulate

    def ends(*given: Any, **options: Any) -> prescribed.Prescribed:
        return replace(honest(*given, **options), status="diverged")

    monkeypatch.setattr(prescribed, "simulate", ends)
    rows = list(crosscheck.check_all(pike, cases=(_STRAIGHT,), duration=0.1))
    assert {row.status for row in rows if row.engine == "MuJoCo"} == {"diverged"}
    assert not any(row.passed for row in rows if row.engine == "MuJoCo")


def test_a_missing_reference_trajectory_is_named(pike: Fish, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"v1_published\.csv: no such file"):
        next(crosscheck.check_all(pike, reference=tmp_path))


def test_prescribed_joints_are_where_they_are_told_to_be(pike: Fish) -> None:
    """The torque of a flywheel is its own: what the water does to it moves a joint by less than 1e-7 rad/s in 1 s."""
    model = prescribed.specification(pike).compile()
    joints = [model.joint(f"joint_{index + 1}").dofadr[0] for index in range(pike.joints)]
    np.testing.assert_array_equal(model.dof_armature[joints], prescribed._FLYWHEEL)
    np.testing.assert_array_equal(model.actuator_gear[:, 0], prescribed._FLYWHEEL)
