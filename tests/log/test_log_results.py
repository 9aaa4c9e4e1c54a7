"""What of a diagnosis becomes part of its log: the fish as each model swims it, whatever the cause acts through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import SIGMA, diagnosis

from mjfish.data import Tank
from mjfish.diagnosis import Diagnosis, Estimate
from mjfish.diagnosis.result import Verdict
from mjfish.errors import InputError
from mjfish.estimation import identify
from mjfish.estimation.settings import Settings
from mjfish.fish import Fish
from mjfish.inspection import Inspection
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.forces import link_forces
from mjfish.reporting.log import Run, Swim, results, write_log
from mjfish.simulation import generate


def _runs(one: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Return the runs that would be written."""
    written: list[Run] = []
    monkeypatch.setattr(results, "write_runs", lambda _path, runs, **_named: written.extend(runs))
    write_log(one, Path("unused.rrd"))
    return written


def _swim(
    cause: str, parameters: dict[str, float], monkeypatch: pytest.MonkeyPatch, verdict: Verdict = "named"
) -> tuple[Diagnosis, dict[str, Swim]]:
    given = {short: Estimate(value, value, value, "-") for short, value in parameters.items()}
    one = diagnosis(verdict, cause=cause, parameters=given)
    run = _runs(one, monkeypatch)[0]
    return one, {swim.swimmer: swim for swim in run.swims}


def _shape(one: Diagnosis, parameters: dict[str, float], time: FloatArray) -> FloatArray:
    """Return the joint angles of the extended model's rollout on the held-out trial, without its tail's deflection."""
    model = one.extended_model
    return model.predict(one.overlays[1].trial, model.values(parameters)).rollout.motion.angle_at(time)


def test_held_out_runs_come_first_and_are_marked(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = _runs(diagnosis(), monkeypatch)
    assert [(run.name, run.held_out) for run in runs] == [("fast", True), ("slow", False)]


def test_a_clock_apart_shows_the_body_at_the_time_of_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    one, swims = _swim("time_offset", {"offset": 0.08}, monkeypatch)
    time = one.overlays[1].trial.time
    early = time < 1.0
    extended = swims["extended"].joint_angle
    assert extended is not None
    shape = _shape(one, {"time_offset.offset": 0.08}, time + 0.08)
    np.testing.assert_allclose(extended[early], shape[early], atol=1e-9)
    nominal = swims["nominal"].joint_angle
    assert nominal is not None
    assert np.max(np.abs(nominal - extended)) > 0.05


def test_a_servo_that_lags_shows_in_the_body(monkeypatch: pytest.MonkeyPatch) -> None:
    one, swims = _swim("servo_lag", {"time_constant": 0.05}, monkeypatch)
    extended = swims["extended"].joint_angle
    assert extended is not None
    shape = _shape(one, {"servo_lag.time_constant": 0.05}, one.overlays[1].trial.time)
    np.testing.assert_allclose(extended, shape, atol=1e-9)


def test_a_tail_that_gives_way_bends_the_last_link_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"compliance": 0.05, "damping": 0.02}
    one, swims = _swim("tail_compliance", values, monkeypatch)
    extended, nominal = swims["extended"].joint_angle, swims["nominal"].joint_angle
    assert extended is not None
    assert nominal is not None
    np.testing.assert_allclose(extended[:, :-1], nominal[:, :-1], atol=1e-5)  # the steps differ
    time = one.overlays[1].trial.time
    model = one.extended_model
    full = model.values({f"tail_compliance.{short}": value for short, value in values.items()})
    deflection = model.predict(one.overlays[1].trial, full).rollout.at(time)[:, 6]
    assert np.ptp(deflection) > 0.05
    np.testing.assert_allclose(extended[:, -1] - nominal[:, -1], deflection, atol=1e-5)


def test_a_current_carries_the_extended_fish_but_pushes_no_link(monkeypatch: pytest.MonkeyPatch) -> None:
    one, swims = _swim("ambient_current", {"x": 0.0, "y": 0.2, "held": 0.0}, monkeypatch)
    extended, nominal = swims["extended"], swims["nominal"]
    drift = extended.pose[:, 1] - nominal.pose[:, 1]
    np.testing.assert_allclose(drift, 0.2 * one.overlays[1].trial.time, atol=0.01)
    still = diagnosis(cause="ambient_current", parameters={k: Estimate(0.0, 0.0, 0.0, "-") for k in ("x", "y", "held")})
    without = {swim.swimmer: swim for swim in _runs(still, monkeypatch)[0].swims}["extended"]
    assert extended.forces is not None
    assert without.forces is not None
    np.testing.assert_allclose(extended.forces.drag, without.forces.drag, atol=1e-6)


def test_a_load_of_an_effect_is_a_force_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    _, swims = _swim("reynolds_drag", {"friction": 0.0, "pressure": 0.5}, monkeypatch)
    forces = swims["extended"].forces
    assert forces is not None
    moving = np.abs(forces.drag[..., 1]) > 0.2  # a link that turns about its middle may have them apart
    same = np.sign(forces.load[..., 1]) == np.sign(forces.drag[..., 1])
    assert np.mean(same[moving]) > 0.95
    assert np.count_nonzero(moving) > 100


def test_the_munk_moment_turns_the_links_of_the_extended_fish(monkeypatch: pytest.MonkeyPatch) -> None:
    _, strong = _swim("munk_moment", {"kappa": 1.0}, monkeypatch)
    forces = strong["extended"].forces
    assert forces is not None
    same = diagnosis(cause="munk_moment", parameters={"kappa": Estimate(0.0, 0.0, 0.0, "-")})
    without = {swim.swimmer: swim for swim in _runs(same, monkeypatch)[0].swims}["extended"].forces
    assert without is not None
    assert np.max(np.abs(forces.added_mass[..., 2] - without.added_mass[..., 2])) > 0.01


def _expected_load(found: Diagnosis, values: dict[str, float]) -> FloatArray:
    """Return the size (n, links) of the force that the effect adds in a rollout of the held-out trial."""
    trial, model = found.overlays[1].trial, found.extended_model
    run = model.prepare(trial, model.values(values))
    rollout = model.predict(trial, model.values(values)).rollout
    forces = link_forces(run.fish, rollout.motion, rollout.at_steps(), values=run.coefficients, loads=run.loads)
    size = np.linalg.norm(forces.load[..., :2], axis=2)
    return np.stack([np.interp(trial.time, rollout.time, column) for column in size.T], axis=1)


def test_a_force_that_remembers_is_drawn_with_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"share": 0.5, "time": 0.15}
    found, swims = _swim("wake_memory", values, monkeypatch)
    forces = swims["extended"].forces
    assert forces is not None
    expected = _expected_load(found, {f"wake_memory.{short}": value for short, value in values.items()})
    assert expected.max() > 0.1
    np.testing.assert_allclose(np.linalg.norm(forces.load[..., :2], axis=2), expected, atol=0.01 * expected.max())


@pytest.mark.parametrize("wide", [True, False])
def test_a_force_near_a_wall_is_drawn_where_the_wall_is(monkeypatch: pytest.MonkeyPatch, wide: bool) -> None:
    """In a wide tank there is none; beside the starting place it is strong at first."""
    values = {"size": 2.0, "reach": 0.2}
    found, _ = _swim("wall_effect", values, monkeypatch)
    tank = Tank((-0.6, 50.0), (-50.0, 50.0)) if not wide else Tank((-50.0, 50.0), (-50.0, 50.0))
    start = np.full((len(found.overlays[1].trial.time), 3), np.nan)
    start[0] = 0.0
    held_out = replace(found.overlays[1], trial=replace(found.overlays[1].trial, tank=tank, pose=start))
    found = replace(found, overlays=(found.overlays[0], held_out))
    forces = {swim.swimmer: swim for swim in _runs(found, monkeypatch)[0].swims}["extended"].forces
    assert forces is not None
    size = np.linalg.norm(forces.load[..., :2], axis=2)
    expected = _expected_load(found, {f"wall_effect.{short}": value for short, value in values.items()})
    np.testing.assert_allclose(size, expected, atol=max(0.01 * expected.max(), 1e-9))
    assert (expected.max() < 1e-9) == wide


def test_a_fit_is_logged_with_its_measured_and_simulated_swims(monkeypatch: pytest.MonkeyPatch, pike: Fish) -> None:
    dataset = generate(pike, ["v1", "v3"], duration=1.5, noise=SIGMA, held_out=["v3"], name="pool")
    found = identify(dataset, Settings(free=("c_d.tail",), starts=1))
    runs: list[Run] = []
    monkeypatch.setattr(results, "write_runs", lambda _path, written, **_named: runs.extend(written))
    write_log(found, Path("unused.rrd"))
    assert [(run.name, run.held_out) for run in runs] == [("v3", True), ("v1", False)]
    for run in runs:
        assert [swim.swimmer for swim in run.swims] == ["measured", "nominal"]
        assert run.swims[1].forces is not None


def test_a_result_without_swimming_is_refused() -> None:
    with pytest.raises(InputError, match="Inspection has no swimming to log"):
        write_log(Inspection(), Path("unused.rrd"))
