"""The shipped demos are those that the tool makes, from its seeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import make_demo
from mjfish.cli.diagnose import DEMO
from mjfish.data import load_dataset
from mjfish.effects import catalogue


def test_the_tool_makes_both_datasets_again(tmp_path: Path) -> None:
    """To the last digit that is written: another processor may round another way."""
    make_demo.make(tmp_path)
    for folder in (".", "learned"):
        made, shipped = tmp_path / folder, DEMO / folder
        names = {path.name for path in shipped.iterdir() if path.is_file()}
        assert {path.name for path in made.iterdir() if path.is_file()} == names
        assert (made / "dataset.toml").read_text() == (shipped / "dataset.toml").read_text()
        for one, other in zip(load_dataset(made).trials, load_dataset(shipped).trials, strict=True):
            np.testing.assert_allclose(one.velocity, other.velocity, atol=1.1e-5)


def test_the_planted_form_is_no_formula_of_the_catalogue_and_falls_with_the_speed() -> None:
    assert make_demo.FallingDrag.name not in catalogue()
    make_demo.FallingDrag.check_declaration()
    speeds = np.array([0.0, make_demo.MIDDLE, 1e3])
    np.testing.assert_allclose(make_demo.coefficient("c_d.head", speeds), 1.9 * np.array([2.5, 1.75, 1.0]), rtol=1e-5)
