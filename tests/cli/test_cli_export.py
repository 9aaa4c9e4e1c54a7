"""``mjfish export``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest
from command_line import Run

import mjfish
from mjfish.fish import load_fish


@pytest.mark.parametrize(("option", "dofs"), [("", 7), ("--free", 10)])
def test_an_exported_fish_is_loaded_by_mujoco_with_its_water(run: Run, tmp_path: Path, option: str, dofs: int) -> None:
    shown = run(f"export pike fish.xml --set c_d.tail=1.25 {option}").stdout
    assert shown == "wrote fish.xml\n"
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "fish.xml"))
    fluid = mjfish.StripFluid(model)
    assert model.nv == dofs
    assert [link.body for link in fluid.links] == ["head", "body_1", "body_2", "body_3", "tail"]
    assert fluid.links[-1].c_d == 1.25
    assert "The fish pike, written by mjfish " in (tmp_path / "fish.xml").read_text(encoding="utf-8").splitlines()[0]


def test_a_fish_goes_through_toml_and_back(run: Run, tmp_path: Path) -> None:
    run("export pike mine.toml --set c_d.tail=1.25")
    assert load_fish(tmp_path / "mine.toml") == load_fish("pike").with_values({"c_d.tail": 1.25})
    run("export mine.toml again.toml")
    assert load_fish(tmp_path / "again.toml") == load_fish(tmp_path / "mine.toml")


def test_misuse_is_refused_and_nothing_written(refuse: Callable[[str], str]) -> None:
    assert "unknown fish 'carp'" in refuse("export carp fish.xml")
    assert "fish.json: the name ends in '.json', expected .xml or .toml; rename it" in refuse("export pike fish.json")
    assert "--free: a fish TOML is neither planar nor free; write an .xml" in refuse("export pike fish.toml --free")
    assert "unknown coefficient 'c_d.fin'" in refuse("export pike fish.xml --set c_d.fin=1")
    assert "cannot be written" in refuse("export pike absent/fish.xml")
