"""Logs read back: what was swum, measured and simulated is in the file, at its time, in its place."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import rerun as rr
from diagnosed import diagnosis
from logs import column, entities, text
from rerun.chunk import RrdReader

from mjfish.errors import InputError, MjfishError
from mjfish.fish import Fish, frames
from mjfish.fish.frames import CHANNELS
from mjfish.ode.forces import link_forces
from mjfish.reporting.log import Run, Swim, view, write_log, write_runs
from mjfish.simulation import simulate


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a named diagnosis."""
    path = tmp_path_factory.mktemp("log") / "fish.rrd"
    write_log(diagnosis(), path)
    return path


def test_velocities_and_residuals_come_back_exactly_at_their_times(log: Path) -> None:
    overlay = diagnosis().overlays[1]
    for k, channel in enumerate(CHANNELS):
        time, measured = column(log, f"/fast/velocity/{channel}/measured", "Scalars:scalars")
        np.testing.assert_allclose(time, overlay.trial.time, atol=1e-9)
        np.testing.assert_array_equal(measured[:, 0], overlay.trial.velocity[:, k])
        _, extended = column(log, f"/fast/velocity/{channel}/with_cause", "Scalars:scalars")
        np.testing.assert_array_equal(extended[:, 0], overlay.extended[:, k])
        _, residual = column(log, f"/fast/residual/{channel}/nominal", "Scalars:scalars")
        np.testing.assert_array_equal(residual[:, 0], (overlay.trial.velocity - overlay.nominal)[:, k])


def test_the_nose_of_the_log_swims_at_the_predicted_velocity(log: Path) -> None:
    """Surge and sway, turned by the logged heading, are the rate of the logged place of the head (trapezoidal rule)."""
    overlay = diagnosis().overlays[1]
    _, place = column(log, "/fast/world/extended/link_0", "Transform3D:translation")
    _, turn = column(log, "/fast/world/extended/link_0", "Transform3D:quaternion")
    time, place, turn = overlay.trial.time, place[:, 0], turn[:, 0]
    yaw = 2.0 * np.arctan2(turn[:, 2], turn[:, 3]) - np.pi
    world = frames.to_world(overlay.extended[:, :2], yaw)
    moved = np.diff(place[:, :2], axis=0) / np.diff(time)[:, None]
    np.testing.assert_allclose(moved, 0.5 * (world[:-1] + world[1:]), atol=1e-4)
    turned = np.diff(np.unwrap(yaw)) / np.diff(time)
    np.testing.assert_allclose(turned, 0.5 * (overlay.extended[:-1, 2] + overlay.extended[1:, 2]), atol=1e-4)
    assert np.ptp(overlay.extended[:, 0]) > 0.5
    np.testing.assert_array_equal(place[0], 0.0)
    np.testing.assert_array_equal(place[:, 2], 0.0)


def test_every_link_has_a_body_and_two_forces(log: Path, pike: Fish) -> None:
    found = entities(log)
    for k in range(len(pike.links)):
        assert {f"/fast/world/{model}/link_{k}" for model in ("nominal", "extended")} <= found
    for kind in ("drag", "added_mass"):
        time, vectors = column(log, f"/fast/world/extended/force/{kind}", "Arrows3D:vectors")
        assert vectors.shape == (len(time), len(pike.links), 3)
        assert np.all(np.abs(vectors[len(time) // 2, :, :2]).max(axis=1) > 0.0)
    assert not any("/nominal/force" in entity for entity in found)  # arrows on one fish are enough
    assert "/fast/world/measured/nose" not in found
    assert {f"/fast/world/measured/link_{k}" for k in range(len(pike.links))} <= found  # those of the command


def test_arrows_are_forces_in_the_scale_that_the_text_tells(log: Path) -> None:
    one = diagnosis()
    overlay, values = one.overlays[1], {name: e.estimate for name, e in one.extended.items()}
    rollout = one.extended_model.predict(overlay.trial, values).rollout
    state = np.concatenate([rollout.state[:, 0], rollout.state[-1:, 1]])
    drag = link_forces(one.nominal_model.fish, rollout.motion, state).drag
    _, vectors = column(log, "/fast/world/extended/force/drag", "Arrows3D:vectors")
    scale = float(text(log, "/about", "TextDocument:text").rpartition("1 N is ")[2].removesuffix(" m."))
    at = np.searchsorted(rollout.time, overlay.trial.time + 1e-9, side="right") - 1
    np.testing.assert_allclose(vectors[..., :2] / scale, drag[at][..., :2], atol=0.02 * np.max(np.abs(drag)))
    assert np.max(np.abs(state[:, 5])) > 0.3  # the fish turns, and the arrows with it


def test_arrows_begin_on_the_links_that_they_push(log: Path, pike: Fish) -> None:
    _, origins = column(log, "/fast/world/extended/force/drag", "Arrows3D:origins")
    for k, link in enumerate(pike.links):
        _, place = column(log, f"/fast/world/extended/link_{k}", "Transform3D:translation")
        _, turn = column(log, f"/fast/world/extended/link_{k}", "Transform3D:quaternion")
        z, w = turn[:, 0, 2], turn[:, 0, 3]
        arm = origins[:, k, :2] - place[:, 0, :2]
        along = arm[:, 0] * (1.0 - 2.0 * z**2) + arm[:, 1] * 2.0 * z * w
        beside = arm[:, 1] * (1.0 - 2.0 * z**2) - arm[:, 0] * 2.0 * z * w
        np.testing.assert_allclose(beside, 0.0, atol=5e-3 * pike.length)
        assert np.all((along > -1e-3) & (along < link.length + 1e-3))
        assert np.ptp(along) > 0.3 * link.length  # where the force acts, not at a fixed place


def test_the_text_tells_the_verdict_and_the_gain(log: Path) -> None:
    told = text(log, "/about", "TextDocument:text")
    assert told.startswith("**Cause named.** Something to say about named.")
    assert "3.14 % of range before, 1.20 % after" in told.replace("\N{NO-BREAK SPACE}", " ")


def test_the_log_opens_with_a_blueprint_of_its_own(log: Path) -> None:
    assert [entry.application_id for entry in RrdReader(log).recordings()] == ["mjfish"]
    assert [entry.application_id for entry in RrdReader(log).blueprints()] == ["mjfish"]


def test_when_nothing_is_wrong_the_nominal_fish_carries_the_forces(tmp_path: Path) -> None:
    path = tmp_path / "fish.rrd"
    write_log(diagnosis("nothing_wrong"), path)
    found = entities(path)
    assert "/slow/world/nominal/force/drag" in found
    assert not any("extended" in entity for entity in found)


def test_measured_joint_angles_and_poses_give_the_measured_fish_a_body(tmp_path: Path, pike: Fish) -> None:
    one = diagnosis()
    trial = one.overlays[0].trial
    wave = 0.2 * np.sin(9.0 * trial.time[:, None] - np.arange(pike.joints))
    pose = np.column_stack([0.3 * trial.time + 1.0, np.full(len(trial.time), 2.0), np.full(len(trial.time), 0.4)])
    seen = replace(one.overlays[0], trial=replace(trial, joint_angle=wave, pose=pose, drive=()))
    path = tmp_path / "fish.rrd"
    write_log(replace(one, overlays=(seen,)), path)
    _, place = column(path, "/slow/world/measured/link_0", "Transform3D:translation")
    np.testing.assert_allclose(place[:, 0, :2], pose[:, :2], atol=1e-6)
    _, simulated = column(path, "/slow/world/extended/link_0", "Transform3D:translation")
    np.testing.assert_allclose(simulated[0, 0, :2], pose[0, :2], atol=1e-6)  # it starts where the measured one does


def test_a_prediction_that_diverged_ends_where_it_diverged(tmp_path: Path) -> None:
    one = diagnosis()
    broken = one.overlays[1].nominal.copy()
    broken[60:] = np.nan
    path = tmp_path / "fish.rrd"
    write_log(replace(one, overlays=(replace(one.overlays[1], nominal=broken),)), path)
    time, _ = column(path, "/fast/velocity/sway/nominal", "Scalars:scalars")
    assert len(time) == 60
    assert len(column(path, "/fast/residual/sway/nominal", "Scalars:scalars")[0]) == 60


def test_names_that_are_no_plain_words_make_paths_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "fish.rrd"
    write_log(diagnosis(names=("a/b c", "Fl\N{LATIN SMALL LETTER U WITH DIAERESIS}gel (2)")), path)
    roots = {entity.split("/velocity/")[0] for entity in entities(path) if "/velocity/" in entity}
    assert len(roots) == 2


@pytest.mark.parametrize("engine", ["ode", "mujoco"])
def test_the_log_of_a_rollout_has_its_forces(tmp_path: Path, pike: Fish, engine: Literal["ode", "mujoco"]) -> None:
    """Those of the joint motion that the engine realised."""
    run = simulate(pike, "v1", engine=engine, duration=2.0)
    time = run.time
    path = tmp_path / "rollout.rrd"
    write_log(run, path)
    _, surge = column(path, "/v1/velocity/surge/simulated", "Scalars:scalars")
    np.testing.assert_array_equal(surge[:, 0], run.velocity[:, 0])
    exact = link_forces(pike, run.motion, run.states).added_mass
    exact = exact[np.searchsorted(run.motion.time[: len(run.states)], time - 1e-9)]
    scale = float(text(path, "/about", "TextDocument:text").rpartition("1 N is ")[2].removesuffix(" m."))
    _, vectors = column(path, "/v1/world/simulated/force/added_mass", "Arrows3D:vectors")
    np.testing.assert_allclose(vectors[..., :2] / scale, exact[..., :2], atol=1e-5 * np.max(np.abs(exact)))


def test_a_run_shorter_than_one_sample_is_logged(tmp_path: Path, pike: Fish) -> None:
    path = tmp_path / "rollout.rrd"
    write_log(simulate(pike, duration=0.005), path)
    assert "/v1/world/simulated/link_4" in entities(path)


def test_a_log_is_written_whole_or_not_at_all(tmp_path: Path, pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    swim = Swim("simulated", np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 4)))
    path = tmp_path / "fish.rrd"
    path.write_text("the log from before")
    monkeypatch.setattr(rr, "LineStrips3D", None)
    with pytest.raises(TypeError):
        write_runs(path, [Run("a", pike, (swim,))], name="pool", about="")
    assert path.read_text() == "the log from before"
    monkeypatch.undo()
    write_runs(path, [Run("a", pike, (swim,))], name="pool", about="")
    assert [p.name for p in tmp_path.iterdir()] == ["fish.rrd"]
    assert "/a/world/simulated/link_4" in entities(path)


def test_a_log_that_cannot_be_written_is_refused_by_name(tmp_path: Path, pike: Fish) -> None:
    swim = Swim("simulated", np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 4)))
    with pytest.raises(InputError, match=r"absent/fish\.rrd: cannot be written"):
        write_runs(tmp_path / "absent" / "fish.rrd", [Run("a", pike, (swim,))], name="pool", about="")
    with pytest.raises(InputError, match="names of their own"):
        write_runs(tmp_path / "fish.rrd", [Run("a", pike, (swim,)), Run("a", pike, (swim,))], name="pool", about="")
    with pytest.raises(InputError, match="needs runs"):
        write_runs(tmp_path / "fish.rrd", [], name="pool", about="")
    assert list(tmp_path.iterdir()) == []


def test_the_viewer_is_run_on_the_file_and_its_failure_is_told(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []

    def run(command: list[str], *, check: bool) -> subprocess.CompletedProcess[bytes]:
        assert not check
        asked.append(command)
        return subprocess.CompletedProcess(command, returncode=len(asked) - 1)

    monkeypatch.setattr(subprocess, "run", run)
    view(log)
    assert asked[0][1:] == ["-m", "rerun", str(log)]
    with pytest.raises(MjfishError, match=r"fish\.rrd: the rerun viewer ended with code 1.* needs a display"):
        view(log)


def test_what_is_no_log_is_not_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fish\.rrd: no such file; .*--rrd"):
        view(tmp_path / "fish.rrd")
    (tmp_path / "fish.rrd").write_text("<html>")
    with pytest.raises(InputError, match=r"fish\.rrd: not a rerun log"):
        view(tmp_path / "fish.rrd")
