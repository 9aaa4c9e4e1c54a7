"""``mjfish fish new`` and ``mjfish fish show``."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import Run

from mjfish.fish import load_fish, shipped

NEW = "fish new trout --length 0.4 --mass 0.6 --joints 2 --height 0.07"


def test_a_new_fish_can_be_shown_and_swims(run: Run, tmp_path: Path) -> None:
    assert "wrote trout.toml" in run(NEW).stdout
    fish = load_fish(tmp_path / "trout.toml")
    assert (fish.name, fish.joints, round(fish.length, 6)) == ("trout", 2, 0.4)
    assert (tmp_path / "trout.toml").read_text(encoding="utf-8").startswith("# A first fish: length, mass, joints")
    shown = run("fish show trout.toml").stdout
    assert "trout: 0.4 m, 0.6 kg, 2 joints" in shown
    assert "Nothing is odd about its numbers." in shown
    assert "mean surge" in run("simulate --fish trout.toml --duration 2 --out swim").stdout


def test_a_file_that_is_there_is_kept(run: Run, tmp_path: Path) -> None:
    run(NEW)
    (tmp_path / "trout.toml").write_text("mine", encoding="utf-8")
    failed = run(NEW, 2)
    assert "trout.toml: is there already; give another name, or --force" in failed.output
    assert (tmp_path / "trout.toml").read_text(encoding="utf-8") == "mine"
    run(f"{NEW} --force")
    assert load_fish(tmp_path / "trout.toml").name == "trout"


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_fish_is_shown_within_80_columns(run: Run, name: str) -> None:
    shown = run(f"fish show {name}").stdout
    for link in load_fish(name).links:
        assert link.name in shown
    table = [line for line in shown.splitlines() if not line.endswith(".")]
    assert max(map(len, table)) <= 80
