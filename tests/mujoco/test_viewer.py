"""The fish in MuJoCo's viewer: what can be seen of it without a window."""

from __future__ import annotations

import contextlib
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.mujoco import StripFluid, mjcf, viewer
from mjfish.mujoco.viewer import DRIVE, Player, Tank
from mjfish.simulation import simulate
from mjfish.simulation.run import tank


def _swim(of: Tank, seconds: float) -> None:
    with of.water.installed():
        for _ in range(round(50.0 * seconds)):
            of.advance(0.02)


def test_the_fish_swims_as_mujoco_simulates_it(pike: Fish) -> None:
    """But for servos that read the command once a step of 2 ms."""
    shown, run = tank(pike, "v1"), simulate(pike, "v1", engine="mujoco", duration=3.0)
    _swim(shown, 3.0)
    assert shown.data.time == pytest.approx(3.0)
    np.testing.assert_allclose(shown.data.qpos[:3], run.pose[-1], atol=0.02)
    assert run.pose[-1, 0] > 0.8


def test_sliders_have_the_values_and_bounds_of_the_fish(pike: Fish) -> None:
    shown = tank(pike, "v1", values={"c_d.tail": 2.0})
    assert set(shown.sliders) == {*DRIVE, *pike.coefficient_names}
    bounds = {p.name: (p.low, p.high) for p in pike.parameters}
    for name, index in shown.sliders.items():
        assert shown.model.actuator(index).name == name
        low, high = bounds.get(name) or DRIVE[name][::2]
        np.testing.assert_allclose(shown.model.actuator_ctrlrange[index], [low, high])
    first = {name: shown.data.ctrl[index] for name, index in shown.sliders.items()}
    assert first["pace"] == first["swing"] == 1.0
    assert first["c_d.tail"] == 2.0
    assert first["c_m.head"] == pike.values["c_m.head"]


def test_sliders_push_with_nothing(pike: Fish) -> None:
    shown = tank(pike, "v1")
    _swim(shown, 0.5)
    np.testing.assert_array_equal(shown.data.actuator_force[list(shown.sliders.values())], 0.0)
    assert np.all(shown.data.actuator_force[: pike.joints] != 0.0)


def test_a_moved_coefficient_is_that_of_the_water_at_once(pike: Fish) -> None:
    """The run goes on from its state as one does that had these coefficients from the start."""
    moved, other = tank(pike, "v1"), tank(pike, "v1", values={"c_d.tail": 0.9})
    _swim(moved, 1.0)
    moved.data.ctrl[moved.sliders["c_d.tail"]] = 0.9
    other.data.qpos[:], other.data.qvel[:] = moved.data.qpos, moved.data.qvel
    other._clock = moved._clock
    _swim(moved, 1.0)
    _swim(other, 1.0)
    assert moved.water.links == other.water.links
    np.testing.assert_allclose(moved.data.qvel, other.data.qvel, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("slider", "value"), [("pace", 0.0), ("swing", 0.0)])
def test_a_drive_that_stands_still_makes_the_fish_slow_down(pike: Fish, slider: str, value: float) -> None:
    shown = tank(pike, "v1")
    _swim(shown, 2.0)
    swum = shown.data.qvel[0]
    shown.data.ctrl[shown.sliders[slider]] = value
    _swim(shown, 3.0)
    assert np.abs(shown.data.qvel[3:]).max() < 1e-3  # the joints are still
    assert abs(shown.data.qvel[0]) < 0.8 * swum


def test_the_fish_turns_to_the_side_of_the_slider(pike: Fish) -> None:
    yaws = []
    for turn in (0.3, -0.3):
        shown = tank(pike, "v1")
        shown.data.ctrl[shown.sliders["turn"]] = turn
        _swim(shown, 3.0)
        yaws.append(shown.data.qpos[2])
    assert yaws[0] * yaws[1] < 0.0
    assert min(map(abs, yaws)) > 0.5


def test_the_drive_goes_on_with_its_last_beat(pike: Fish) -> None:
    run = simulate(pike, "v1", duration=1.0)
    beat = 2.0 * np.pi / 18.0
    player = Player(run.prepared.motion, beat)
    end = float(run.prepared.motion.time[-1])
    np.testing.assert_allclose(player.angle(end + 0.3 * beat), player.angle(end - 0.7 * beat))
    np.testing.assert_allclose(player.angle(end + 7.3 * beat), player.angle(end - 0.7 * beat))
    assert not np.allclose(player.angle(end), player.angle(end - 0.5 * beat), atol=0.05)


def test_effects_with_hidden_states_act_in_the_viewer_too(pike: Fish) -> None:
    plain, remembering = tank(pike), tank(pike, values={"wake_memory.share": 0.6, "wake_memory.time": 0.2})
    assert remembering.model.na > 0
    for shown in (plain, remembering):
        _swim(shown, 1.5)
    assert abs(plain.data.qvel[0] - remembering.data.qvel[0]) > 0.01
    assert np.any(remembering.data.act != 0.0)


def test_a_run_that_diverges_begins_anew_with_its_sliders(pike: Fish) -> None:
    shown = tank(pike)
    shown.data.ctrl[shown.sliders["swing"]] = 0.5
    shown.data.qvel[0] = np.nan
    _swim(shown, 0.1)
    assert np.all(np.isfinite(shown.data.qpos))
    assert shown.data.ctrl[shown.sliders["swing"]] == 0.5


def test_a_free_fish_swims_in_space(pike: Fish) -> None:
    shown = tank(pike, free=True)
    _swim(shown, 1.0)
    assert shown.model.nq == 7 + pike.joints
    assert shown.data.qpos[0] > 0.1


class _Window:
    """Stands for the viewer: open for some pictures, its user moves a slider."""

    def __init__(self, shown: Tank, pictures: int) -> None:
        self.cam: Any = SimpleNamespace()
        self.opt = mujoco.MjvOption()
        self.shown, self.left, self.times = shown, pictures, []
        self.arrows: list[int] = []

    def is_running(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def lock(self) -> contextlib.nullcontext[None]:
        return contextlib.nullcontext()

    def sync(self) -> None:
        self.times.append(self.shown.data.time)
        model, data, scene = self.shown.model, self.shown.data, mujoco.MjvScene(self.shown.model, maxgeom=1000)
        mujoco.mjv_updateScene(model, data, self.opt, None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL, scene)
        arrow = mujoco.mjtGeom.mjGEOM_ARROW
        self.arrows.append(sum(geom.type == arrow for geom in scene.geoms[: scene.ngeom]))
        self.shown.data.ctrl[self.shown.sliders["c_d.tail"]] = 1.5


def test_the_viewer_is_kept_up_to_date_until_it_is_closed(pike: Fish) -> None:
    shown = tank(pike)
    window = _Window(shown, 5)
    with shown.water.installed():
        viewer.swim(shown, window)
    np.testing.assert_allclose(window.times, 0.02 * np.arange(1, 6))
    assert window.arrows == [len(pike.links)] * 5
    assert window.cam.trackbodyid == shown.model.body("head").id
    assert shown.water.links[-1].c_d == 1.5


@pytest.mark.parametrize("free", [False, True])
def test_arrows_are_the_whole_force_of_the_water(pike: Fish, free: bool) -> None:
    """MuJoCo draws them from `xfrc_applied`, in the steady state neither as a dot nor far longer than the fish."""
    shown = tank(pike, free=free)
    with shown.water.installed():
        shown.advance(3.0)
        mujoco.mj_forward(shown.model, shown.data)
        applied = shown.data.xfrc_applied[[shown.model.body(link.name).id for link in pike.links]]
        np.testing.assert_allclose(applied, shown.water.wrenches(shown.data)["total"], rtol=1e-9, atol=1e-12)
        lengths = np.linalg.norm(applied[:, :3], axis=1) * shown.model.vis.map.force / shown.model.stat.meanmass
    assert 0.02 < lengths.max() / pike.length < 2.0


def test_without_a_display_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(InputError, match=r"--viewer: there is no display .* mjfish render"):
        viewer.check_display()


def test_a_display_that_does_not_answer_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    glfw = pytest.importorskip("glfw")
    monkeypatch.setenv("DISPLAY", ":987")
    monkeypatch.setattr(glfw, "init", lambda: False)
    with pytest.raises(InputError, match="there is no display"):
        viewer.check_display()


def test_coefficients_outside_their_bounds_have_a_slider_all_the_same(pike: Fish) -> None:
    """Such as those of a fit under other bounds: the slider reaches so far."""
    run = simulate(pike, "v1", duration=0.5).prepared
    high = pike.parameters[0].high + 1.0
    shown = Tank(pike, Player(run.motion, 0.3), values={pike.parameters[0].name: high})
    assert shown.model.actuator_ctrlrange[shown.sliders[pike.parameters[0].name], 1] == high
    assert isinstance(shown.water, StripFluid)
    assert shown.water.links == mjcf.strips(pike, {pike.parameters[0].name: high})
