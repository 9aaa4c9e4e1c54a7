"""``mjfish simulate --free``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from command_line import Run

from mjfish.data import read_table
from mjfish.drive import cpg, modes
from mjfish.fish import load_fish
from mjfish.mujoco import Trim, simulate


def test_a_free_run_has_roll_pitch_and_heave(run: Run, tmp_path: Path) -> None:
    """Catches columns under each other's names."""
    run("simulate --engine mujoco --free --duration 1 --out a")
    table = read_table(tmp_path / "a" / "rollout.csv")
    pike = load_fish("pike")
    there = simulate(pike, cpg.joint_motion(pike.cpg, modes.drive("v1"), 1.0, 0.001), free=Trim())
    for name, series in zip(("roll", "pitch", "heave"), there.attitude.T, strict=True):
        np.testing.assert_allclose(table[name], np.interp(table["time"], there.time, series), rtol=0, atol=1e-9)
    angle = np.interp(table["time"], there.time, there.joint_angle[:, 3])
    np.testing.assert_allclose(table["joint_4"], angle, rtol=0, atol=1e-9)
    assert np.abs(table["roll"]).max() > 0.1
    assert (tmp_path / "a" / "rollout.rrd").stat().st_size > 1000


def test_a_planar_run_has_none_of_them(run: Run, tmp_path: Path) -> None:
    run("simulate --engine mujoco --duration 0.2 --out a")
    assert not {"roll", "pitch", "heave"} & set(read_table(tmp_path / "a" / "rollout.csv"))


def test_the_ode_cannot_be_free(refuse: Callable[[str], str]) -> None:
    assert "free: the ODE is planar; choose the engine mujoco" in refuse("simulate --free --out a")
