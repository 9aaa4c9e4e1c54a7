"""Every engine on prescribed joints: agrees where it is right, is seen where it is not."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import prescribed
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.model import Model, extended
from mjfish.model.extended import Extended
from studies import console, engines

_STRAIGHT = engines.CASES[0]
_TURN = engines.CASES[2]


def test_every_engine_agrees_at_the_order_of_its_integrator(pike: Fish) -> None:
    """A term that is missing, lagged, or doubled in one coupling or integrator leaves a difference that stays."""
    rows = list(engines.sweep(pike, cases=(_STRAIGHT,), duration=1.5))
    assert [row.status for row in rows] == ["agrees"] * len(engines.ENGINES)
    fourth = [row for row in rows if row.engine.order == 4]
    assert all(row.to_ode < 1e-6 and row.order > 3.5 for row in fourth)
    assert all(abs(row.order - 1.0) < 0.2 for row in rows if row.engine.order == 1)
    assert all(math.isnan(row.to_reference) for row in rows)


@pytest.mark.parametrize("case", engines.CASES, ids=lambda case: case.name)
def test_mujoco_reproduces_the_reference_trajectories(
    case: engines.Case, reference: Path, pike: Fish, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Start-up and the jump of the joints' rate included: the trajectories share no equation with either engine."""
    monkeypatch.setattr(engines, "ENGINES", engines.ENGINES[:3])
    rows = list(engines.sweep(pike, cases=(case,), reference=reference))
    assert [row.status for row in rows] == ["agrees"] * 3
    assert max(row.to_reference for row in rows) < 1e-5  # worst seen: 5.0e-6, the trajectory's own


@pytest.mark.parametrize("integrator", ["implicitfast", "implicit", "discrete"])
def test_the_whole_wrench_is_refused_under_implicit_integrators(
    pike: Fish, monkeypatch: pytest.MonkeyPatch, integrator: Any
) -> None:
    """Catches a row that names another coupling than the one that ran: where both are right they swim alike."""
    monkeypatch.setattr(engines, "ENGINES", (engines.Engine("MuJoCo", "xfrc", integrator, 1),))
    with pytest.raises(InputError, match="xfrc"):
        next(engines.sweep(pike, cases=(_STRAIGHT,), duration=0.1))


def test_momentum_of_the_root_is_kept_where_the_rates_of_the_joints_jump(pike: Fish) -> None:
    """Without the impulse of the joints the turn would start a tenth of a metre a second off."""
    rows = [row for row in engines.sweep(pike, cases=(_TURN,), duration=5.4) if row.engine.integrator == "RK4"]
    assert all(row.to_ode < 1e-6 for row in rows)


def test_an_engine_with_another_water_is_seen(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """One coefficient one percent off in MuJoCo alone."""
    honest = prescribed.simulate

    def slip(fish: Fish, motion: Any, *, values: dict[str, float], **options: Any) -> prescribed.Prescribed:
        return honest(fish, motion, values={**values, "c_d.tail": 1.01 * values["c_d.tail"]}, **options)

    monkeypatch.setattr(prescribed, "simulate", slip)
    rows = list(engines.sweep(pike, cases=(_STRAIGHT,), duration=1.0))
    assert {row.status for row in rows if row.engine.name == "ODE"} == {"agrees"}
    assert {row.status for row in rows if row.engine.name == "MuJoCo"} == {"disagrees"}


def test_a_run_that_diverges_is_a_row(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = prescribed.simulate

    def ends(*given: Any, **options: Any) -> prescribed.Prescribed:
        return replace(honest(*given, **options), status="diverged")

    monkeypatch.setattr(prescribed, "simulate", ends)
    rows = list(engines.sweep(pike, cases=(_STRAIGHT,), duration=0.1))
    assert {row.status for row in rows if row.engine.name == "MuJoCo"} == {"diverged"}


def test_a_missing_reference_trajectory_is_named(pike: Fish, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"v1_published\.csv: no such file"):
        next(engines.sweep(pike, reference=tmp_path))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time [s],surge [m/s],sway [m/s],yaw_rate [rad/s]\n", "has a header and no rows"),
        ("time [s],surge [m/s]\n0,0\n", r"column 'sway \[m/s\]' is missing"),
        ("time [s],surge [m/s],sway [m/s],yaw_rate [rad/s]\n1,0,0,0\n0,0,0,0\n", "times do not increase"),
    ],
)
def test_a_damaged_reference_trajectory_is_refused(pike: Fish, tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / f"{_STRAIGHT.name}.csv").write_text(text)
    with pytest.raises(InputError, match=complaint):
        next(engines.sweep(pike, cases=(_STRAIGHT,), reference=tmp_path, duration=0.1))


def test_a_fish_that_the_runs_cannot_have_is_named(pike: Fish) -> None:
    """Catches engines that agree because the run of a mode has no walls."""
    one = Extended(Model(pike, (find("wall_effect"),)), {"wall_effect.size": 1.0})
    with pytest.raises(InputError, match="wall_effect: the walls are not known"):
        next(engines.sweep(one))
    with pytest.raises(InputError, match="has no CPG"):
        next(engines.sweep(pike.model_copy(update={"cpg": None})))


def _told(monkeypatch: pytest.MonkeyPatch, *arguments: str, exit_code: int = 0) -> str:
    """Return what the study says in a wide terminal, of runs of half a second without reference trajectories."""
    monkeypatch.delenv("MJFISH_REFERENCE", raising=False)
    for one in (console.out, console.err):
        monkeypatch.setattr(one, "_width", 120)
    monkeypatch.setattr(engines, "sweep", functools.partial(engines.sweep, duration=0.5))
    result = CliRunner().invoke(engines.app, arguments)
    assert result.exit_code == exit_code, result.output
    return result.output


def test_the_study_shows_a_row_an_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = _told(monkeypatch, "v1")
    (headings,) = (line for line in shown.splitlines() if "coupling" in line)
    for word in ("mode", "engine", "integrator", "step", "to ODE", "to ref.", "order", "verdict"):
        assert word in headings
    assert sum(line.split()[-1:] == ["agrees"] for line in shown.splitlines()) == len(engines.ENGINES)
    assert "no reference trajectories: name their folder by --reference" in shown


def test_the_study_exits_with_1_where_an_engine_disagrees(
    pike: Fish, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """On a fish whose effects are said."""
    extended.write(tmp_path / "bent.toml", Model(pike, (find("roll_loss"),)), {"roll_loss.square": 1.0})
    monkeypatch.setattr(engines, "LEFT", 0.0)
    monkeypatch.setattr(engines, "ENGINES", engines.ENGINES[:1])
    told = _told(monkeypatch, "v1", "--fish", str(tmp_path / "bent.toml"), exit_code=1)
    assert "with roll_loss: square = 1" in told
    assert "disagrees" in told


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("v7",), "error: unknown mode 'v7'; known: v1, v1-t1, v3-t2, v5-v1"),
        (("--fish", "eth_tendon"), "error: fish 'eth_tendon' has no CPG to drive it"),
        (("--fish", "carp"), "error: unknown fish 'carp'"),
        (("--reference", "absent"), "v1_published.csv: no such file"),
    ],
)
def test_the_study_refuses_misuse(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], complaint: str) -> None:
    assert complaint in _told(monkeypatch, *arguments, exit_code=console.MISUSE)


def test_prescribed_joints_are_where_they_are_told_to_be(pike: Fish) -> None:
    """The torque of a flywheel is its own: what the water does to it moves a joint by less than 1e-7 rad/s in 1 s."""
    model = prescribed.specification(pike).compile()
    joints = [model.joint(f"joint_{index + 1}").dofadr[0] for index in range(pike.joints)]
    np.testing.assert_array_equal(model.dof_armature[joints], prescribed._FLYWHEEL)
    np.testing.assert_array_equal(model.actuator_gear[:, 0], prescribed._FLYWHEEL)
