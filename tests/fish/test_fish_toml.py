"""A fish goes through a TOML file unchanged."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish import fish as fishes
from mjfish.errors import InputError
from mjfish.fish import Fish, fish_text, load_fish, write_fish


def _odd(fish: Fish, seed: int = 5) -> Fish:
    """Return the fish with values, starts and bounds that need all 17 digits."""
    draw = np.random.default_rng(seed)
    changed = {}
    for p in fish.parameters:
        low, start, value, high = sorted(p.low + (p.high - p.low) * draw.random() for _ in range(4))
        changed[p.name] = replace(p, default=value, start=start, low=low, high=high)
    return fish.with_coefficients(changed)


@pytest.mark.parametrize("name", sorted(fishes.shipped()))
def test_a_written_fish_is_read_back_to_the_last_bit(name: str, tmp_path: Path) -> None:
    """Catches a rounded number, a lost start or bound, a missing [cpg] written as something."""
    fish = _odd(load_fish(name)).model_copy(update={"munk_moment": 0.1 + 0.2, "about": 'a "b"\n\\ c # Ä'})
    write_fish(tmp_path / "mine.toml", fish)
    back = load_fish(tmp_path / "mine.toml")
    assert back == fish
    assert back.values == fish.values != load_fish(name).values
    assert [(p.start, p.low, p.high) for p in back.parameters] == [(p.start, p.low, p.high) for p in fish.parameters]
    assert list(tmp_path.iterdir()) == [tmp_path / "mine.toml"]


def test_comments_stand_at_the_top_and_change_nothing(pike: Fish, tmp_path: Path) -> None:
    """Also one with a line end or a control character in it, which would end the comment or the file's validity."""
    write_fish(tmp_path / "mine.toml", pike, ["from 'pool'\nname = 7", "bell \a and \x7f", ""])
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert text.splitlines()[:5] == ["# from 'pool'", "# name = 7", "# bell   and", "schema = 1", 'name = "pike"']
    assert load_fish(tmp_path / "mine.toml") == pike
    assert tomllib.loads(text)["name"] == "pike"


def test_the_file_reads_like_one_made_by_hand(pike: Fish) -> None:
    lines = fish_text(pike).splitlines()
    assert "[coefficients.c_d]" in lines
    assert "head = {value = 4.0, start = 2.0, low = 0.1, high = 4.0}" in lines
    assert lines.count("[[links]]") == 5
    assert 'profile = "elliptic"' in lines


def test_a_fish_that_breaks_its_schema_is_not_written(pike: Fish, tmp_path: Path) -> None:
    """`model_copy` checks nothing; what cannot be read back must not be left behind."""
    broken = pike.model_copy(update={"density": -1.0})
    with pytest.raises(InputError, match=r"fish 'pike': density: must be above 0; correct it \(found -1.0\)"):
        write_fish(tmp_path / "mine.toml", broken)
    assert not list(tmp_path.iterdir())


def test_another_suffix_or_no_folder_is_refused(pike: Fish, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mine\.json: the name ends in '\.json', expected \.toml; rename it"):
        write_fish(tmp_path / "mine.json", pike)
    with pytest.raises(InputError, match="cannot be written"):
        write_fish(tmp_path / "absent" / "mine.toml", pike)


def test_every_coefficient_is_in_the_file(pike: Fish) -> None:
    table = tomllib.loads(fish_text(pike))["coefficients"]
    assert [f"{kind}.{group}" for kind, groups in table.items() for group in groups] == list(COEFFICIENTS)
