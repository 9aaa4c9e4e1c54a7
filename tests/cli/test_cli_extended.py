"""``mjfish simulate`` and ``mjfish check`` of a fish with its effects."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Run

from mjfish import simulation as crosscheck
from mjfish.data import Trial, read_table
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model, extended
from mjfish.numerics.arrays import FloatArray

_VALUES = {
    "c_d.tail": 2.25, "linear_drag.along": 1.0, "linear_drag.across": 80.0, "tail_compliance.compliance": 0.2,
    "ambient_current.x": 0.05, "ambient_current.y": -0.03, "time_offset.offset": 0.02,
}  # fmt: skip


@pytest.fixture
def model(pike: Fish, tmp_path: Path) -> Model:
    """A model with causes of body, water and camera, written to extended.toml."""
    names = ("linear_drag", "tail_compliance", "ambient_current", "time_offset")
    made = Model(pike, tuple(find(name) for name in names), step=0.001)
    extended.write(tmp_path / "extended.toml", made, _VALUES)
    return made


def _velocity(folder: Path) -> tuple[FloatArray, FloatArray]:
    table = read_table(folder / "rollout.csv")
    return table["time"], np.column_stack([table[name] for name in ("surge", "sway", "yaw_rate")])


def test_a_rollout_of_the_ode_is_what_the_model_predicts(run: Run, tmp_path: Path, model: Model) -> None:
    """Body, loads, clock and reading included. Catches an effect that is left out, and one that is said to be off."""
    shown = run("simulate --fish extended.toml --mode v3 --duration 2 --out a").stdout
    time, found = _velocity(tmp_path / "a")
    trial = Trial("v3", None, time, np.zeros((len(time), 3)), drive=modes.drive("v3"))
    expected = model.predict(trial, model.values(_VALUES)).velocity
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert "with linear_drag: along = 1 N s/m3, across = 80 N s/m3\n" in shown
    assert "with time_offset: offset = 0.02 s; it changes what the camera reads, not the swimming" in shown


def test_mujoco_swims_with_them_too(run: Run, tmp_path: Path, model: Model) -> None:
    """Nearer to the ODE with the causes than either engine is to the fish without: servos are all that is between."""
    apart = {}
    for name, option in (("on", ""), ("off", "--set linear_drag.along=0 --set linear_drag.across=0")):
        for engine in ("ode", "mujoco"):
            run(
                f"simulate --fish extended.toml {option} --engine {engine} --mode v1 --duration 2 --out {name}_{engine}"
            )
        apart[name] = [_velocity(tmp_path / f"{name}_{engine}")[1] for engine in ("ode", "mujoco")]
    (ode, mujoco), (dry, dry_mujoco) = apart["on"], apart["off"]
    np.testing.assert_allclose((mujoco - dry_mujoco)[100:, 0].mean(), (ode - dry)[100:, 0].mean(), rtol=0.15)
    assert abs((ode - dry)[100:, 0].mean()) > 0.005


def test_the_engines_are_checked_with_the_causes_on(run: Run, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crosscheck, "check", functools.partial(crosscheck.check, duration=1.0, halvings=1))
    shown = run("check --mode v1 --fish extended.toml").stdout
    assert "v1: agrees" in shown
    assert "with tail_compliance: compliance = 0.2 rad/(N m), damping = 0.02 N m s/rad" in shown
    del model


def test_commands_that_know_no_effects_refuse_the_fish(refuse: Callable[[str], str], model: Model) -> None:
    """An MJCF has no causes in it."""
    assert "extended.toml: has [effects], which are lost here" in refuse("export extended.toml a.xml")
    del model


def test_a_cause_of_ones_own_needs_its_file(run: Run, refuse: Callable[[str], str], tmp_path: Path, pike: Fish) -> None:
    source = Path(__file__).parents[1] / "effects" / "own_effects.py"
    (tmp_path / "mine.py").write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    mine = extended.catalogue([tmp_path / "mine.py"])["linear_damping"]
    extended.write(tmp_path / "own.toml", Model(pike, (mine,)), {"linear_damping.coefficient": 0.3})
    assert "unknown effect 'linear_damping'" in refuse("simulate --fish own.toml --out a")
    for engine in ("ode", "mujoco"):
        shown = run(
            f"simulate --fish own.toml --effects mine.py --duration 0.5 --engine {engine} --out {engine}"
        ).stdout
        assert "with linear_damping: coefficient = 0.3 N s/m" in shown
