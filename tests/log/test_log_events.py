"""Events, joints, beats and views of a log: what happens when, and what is in sight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import diagnosis
from logs import column, entities, text
from rerun.chunk import RrdReader

from mjfish.fish import Fish
from mjfish.model import requested_motion
from mjfish.ode.rollout import STEP
from mjfish.reporting.log import recording, write_log
from mjfish.reporting.log.drawing import GHOST, beat_paths, camera_path, drawn, reach
from mjfish.reporting.log.results import events_of
from mjfish.reporting.log.scene import Run, Swim
from mjfish.simulation import simulate


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a named diagnosis."""
    path = tmp_path_factory.mktemp("log") / "fish.rrd"
    write_log(diagnosis(), path)
    return path


def _events(path: Path, entity: str) -> list[tuple[float, str]]:
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if "TextLog:text" in batch.schema.names:
            times = np.asarray(batch.column("sim_time").cast("int64")) * 1e-9
            return list(
                zip(times.round(6).tolist(), (one[0] for one in batch.column("TextLog:text").to_pylist()), strict=True)
            )
    raise AssertionError(f"{entity} has no events")


def test_start_and_changes_of_the_drive_are_events_at_their_time(log: Path) -> None:
    held_out, fitted = dict(_events(log, "/fast/events")), dict(_events(log, "/slow/events"))
    assert held_out[0.0] == "start of a held-out run: nothing was fitted to it, from rest"
    assert fitted[0.0] == "start of a fitted run, from rest"
    assert held_out[1.2] == "the drive changes: a turn begins"


def _still(who: str, time: np.ndarray, angle: np.ndarray, **named: object) -> Swim:
    zero = np.zeros((len(time), 3))
    return Swim(who, time, zero, zero, angle, **named)


def test_joints_that_fall_short_gaps_and_ends_are_events() -> None:
    trial = diagnosis().overlays[0].trial
    kept = np.r_[0:40, 50:101]
    trial = replace(trial, time=trial.time[kept], velocity=trial.velocity[kept], gaps=True, drive=trial.drive[:1])
    time = trial.time
    asked = np.tile(0.5 * np.sin(9.0 * time)[:, None], (1, 4))
    stuck = asked.copy()
    stuck[time > 1.0, 2] = 0.0  # the third joint stops
    nominal = _still("nominal", time[:60], asked[:60])
    extended = _still("extended", time, stuck, words="with a fault")
    found = events_of(trial, False, (_still("measured", time, asked, ghost=True), nominal, extended))
    assert [when for when, _ in found] == sorted(when for when, _ in found)
    words = {said: when for when, said in found}
    assert words["no samples for 0.22 s"] == pytest.approx(0.78)
    assert words["nominal: the simulation diverges"] == pytest.approx(time[59])
    (short,) = [said for said in words if "command" in said]
    assert short.startswith("with a fault: joint 3 is ")
    assert 1.0 < words[short] < 1.2
    same = events_of(trial, False, (_still("measured", time, stuck), extended))
    assert not any("command" in said for _, said in same)  # the angles were measured: nothing was commanded


def test_commanded_and_realised_angles_and_the_beat_are_in_the_log(log: Path, pike: Fish) -> None:
    overlay = diagnosis().overlays[1]
    time, asked = column(log, "/fast/joints/joint_4/command", "Scalars:scalars")
    expected = requested_motion(pike.cpg, overlay.trial, STEP).angle_at(overlay.trial.time)[:, 3]
    np.testing.assert_allclose(time, overlay.trial.time, atol=1e-9)
    np.testing.assert_allclose(asked[:, 0], expected, atol=1e-9)
    _, lagging = column(log, "/fast/joints/joint_4/with_cause", "Scalars:scalars")
    assert np.max(np.abs(lagging - asked)) > 0.05  # the servos lag
    assert "/fast/joints/joint_4/measured" not in entities(log)  # nobody measured it
    time, beat = column(log, "/fast/joints/phase/beat", "Scalars:scalars")
    assert np.all((beat >= 0.0) & (beat < 1.0))
    late = time > 0.4
    turned = np.abs(np.diff(np.unwrap(2.0 * np.pi * beat[late, 0])))
    assert np.sum(turned) / np.ptp(time[late]) == pytest.approx(20.0, rel=0.05)  # omega of the drive


def test_the_ghost_has_the_shape_of_the_command(log: Path, pike: Fish) -> None:
    overlay = diagnosis().overlays[1]
    _, turn = column(log, "/fast/world/measured/link_4", "Transform3D:quaternion")
    _, head = column(log, "/fast/world/measured/link_0", "Transform3D:quaternion")
    bend = [2.0 * np.arctan2(q[:, 0, 2], q[:, 0, 3]) for q in (turn, head)]
    asked = requested_motion(pike.cpg, overlay.trial, STEP).angle_at(overlay.trial.time).sum(axis=1)
    np.testing.assert_allclose(np.sin(bend[0] - bend[1]), np.sin(asked), atol=1e-5)


def _opacity(path: Path, entity: str) -> int:
    """Return the last byte of the colour of a body."""
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if "Mesh3D:albedo_factor" in batch.schema.names:
            return int(batch.column("Mesh3D:albedo_factor").to_pylist()[0][0]) & 0xFF
    raise AssertionError(f"{entity} has no body")


def test_the_ghost_has_the_opacity_of_a_ghost(log: Path) -> None:
    assert _opacity(log, "/fast/world/measured/link_0") == GHOST
    assert _opacity(log, "/fast/world/extended/link_0") > GHOST


def test_paths_begin_anew_on_the_measured_one(log: Path, pike: Fish) -> None:
    assert {f"/fast/world/{who}/beats" for who in ("nominal", "extended")} <= entities(log)
    time = np.linspace(0.0, 2.0, 101)
    still = np.zeros((101, 4))
    poses = [np.column_stack([speed * time, 0.0 * time, 0.0 * time]) for speed in (0.5, 0.6)]
    swims = tuple(
        Swim(who, time, np.zeros((101, 3)), pose, still)
        for who, pose in zip(("measured", "nominal"), poses, strict=True)
    )
    measured, nominal = drawn(Run("a", pike, swims), 1.0).figures
    pieces = beat_paths(nominal, measured, np.array([0.0, 1.0]))
    np.testing.assert_allclose([piece[0, 0] for piece in pieces], [0.0, 0.5], atol=1e-9)
    np.testing.assert_allclose([piece[-1, 0] for piece in pieces], [0.6, 1.1], atol=1e-9)


def test_the_text_tells_how_far_paths_drift_apart(log: Path) -> None:
    told = text(log, "/about", "TextDocument:text")
    assert "Paths add up the errors of the velocities" in told
    (line,) = [line for line in told.splitlines() if line.startswith("- fast: ")]
    _, place = column(log, "/fast/world/nominal/link_0", "Transform3D:translation")
    _, there = column(log, "/fast/world/measured/link_0", "Transform3D:translation")
    apart = float(line.partition("the nominal one ")[2].split()[0])
    assert apart == pytest.approx(np.linalg.norm(place[-1] - there[-1]), rel=0.06)
    assert "and the extended one " in line


def _apart(pike: Fish, gap: float) -> Run:
    time, still = np.linspace(0.0, 2.0, 101), np.zeros((101, 4))
    poses = [np.column_stack([0.3 * time, sign * gap * time, 0.0 * time]) for sign in (-1.0, 1.0)]
    swims = [
        Swim(who, time, np.zeros((101, 3)), pose, still)
        for who, pose in zip(("measured", "nominal"), poses, strict=True)
    ]
    return Run("a", pike, tuple(swims))


def test_the_camera_keeps_fish_in_view_that_part(pike: Fish) -> None:
    near, far = (_apart(pike, gap) for gap in (0.0, 0.6))
    assert recording._far(near, drawn(near, 1.0)) == pike.length
    drawing = drawn(far, 1.0)
    time = far.swims[0].time
    path = camera_path(drawing.figures, time)
    np.testing.assert_allclose(path[:, 1], 0.0, atol=1e-9)  # between the two
    assert reach(drawing.figures, path, time) > 1.2
    assert recording._far(far, drawing) > 1.2


def test_a_tab_has_views_from_aside_and_from_above_and_tells_events(pike: Fish) -> None:
    run = replace(_apart(pike, 0.1), events=((0.0, "start"),))
    tab = recording._tab(run, drawn(run, 1.0))
    left, _, others = tab.contents
    views, said = left.contents
    assert [view.name for view in views.contents] == ["Swimming", "From above"]
    assert [view.name for view in said.contents] == ["About", "Events"]
    assert [view.name for view in others.contents] == ["Residuals", "Joints"]


def test_the_extended_curve_is_drawn_last(log: Path) -> None:
    """The viewer draws curves in the order of their entities."""
    for kind in ("velocity", "residual"):
        curves = sorted(entity for entity in entities(log) if entity.startswith(f"/fast/{kind}/surge/"))
        assert curves[-1].endswith("/with_cause")
        assert len(curves) == (3 if kind == "velocity" else 2)


def test_a_rollout_has_its_command_too(tmp_path: Path, pike: Fish) -> None:
    """The servos of MuJoCo follow it a little late."""
    write_log(simulate(pike, "v1", engine="mujoco", duration=1.0), tmp_path / "a.rrd")
    _, asked = column(tmp_path / "a.rrd", "/v1/joints/joint_4/command", "Scalars:scalars")
    _, swum = column(tmp_path / "a.rrd", "/v1/joints/joint_4/simulated", "Scalars:scalars")
    assert np.max(np.abs(asked - swum)) > 0.01
    assert np.corrcoef(asked[:, 0], swum[:, 0])[0, 1] > 0.97
    assert _events(tmp_path / "a.rrd", "/v1/events") == [(0.0, "start")]
