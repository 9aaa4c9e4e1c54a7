"""What of a diagnosis becomes part of its log: the fish as each model swims it, whatever the cause acts through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.arrays import FloatArray
from mjfish.diagnosis import Diagnosis, Estimate
from mjfish.diagnosis.result import Verdict
from mjfish.reporting.log import Run, Swim, of_diagnosis, write_diagnosis_log


def _runs(one: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Return the runs that would be written."""
    written: list[Run] = []
    monkeypatch.setattr(of_diagnosis, "write_log", lambda _path, runs, **_told: written.extend(runs))
    write_diagnosis_log(one, Path("unused.rrd"))
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
