"""Walls of the tank in dataset.toml."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trials
from mjfish.data import Dataset, Tank
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.simulation.synthetic import generate

TANK = Tank((-2.0, 30.0), (-3.0, 4.0))


@pytest.fixture
def swum(pike: Fish) -> Dataset:
    return generate(pike, ["v1", "v3"], duration=0.5, tank=TANK, places=[(0.0, 0.0, 0.1), (1.0, -1.0, 0.0)])


def test_a_tank_is_read_as_written(swum: Dataset, tmp_path: Path) -> None:
    file = trials.save(swum, tmp_path / "data")
    read = trials.load_dataset(file)
    assert [trial.tank for trial in read.trials] == [TANK, TANK]
    for found, given in zip(read.trials, swum.trials, strict=True):
        assert found.pose is not None
        assert given.pose is not None
        assert np.array_equal(found.pose, given.pose)
    bare = replace(swum, trials=tuple(replace(trial, tank=None) for trial in swum.trials))
    assert "tank" not in trials.save(bare, tmp_path / "bare").read_text()


def test_distance_is_to_the_nearest_wall() -> None:
    places = np.array([[0.0, 0.0, 0.0], [29.0, 0.0, 0.0], [0.0, 3.5, 0.0], [-2.5, 0.0, 0.0]])
    np.testing.assert_allclose(TANK.distance(places), [2.0, 1.0, 0.5, -0.5])


@pytest.mark.parametrize(
    ("tank", "message"),
    [
        ("tank = {x = [3.0, -2.0], y = [0.0, 1.0]}", r"tank\.x: .*walls are at 3 and -2 m"),
        ("tank = {x = [-2.0, 3.0]}", r"tank\.y"),
        ("tank = {x = [-2.0], y = [0.0, 1.0]}", r"tank\.x"),
        ('tank = {x = ["a", 1.0], y = [0.0, 1.0]}', r"tank\.x"),
        ("tank = {x = [-2.0, 3.0], y = [0.0, 1.0], z = 2.0}", r"tank\.z"),
        (
            "tank = {x = [-2.0, 30.0], y = [-0.5, 4.0]}",
            r"v3\.csv: row 1 \(line 2\): x = 1 m, y = -1 m, expected .* tank",
        ),
    ],
)
def test_a_wrong_tank_is_refused(swum: Dataset, tmp_path: Path, tank: str, message: str) -> None:
    file = trials.save(swum, tmp_path / "data")
    text = file.read_text()
    start = text.index("[tank]") if "[tank]" in text else text.index("tank")
    stop = text.index("\n\n", start) if "[tank]" in text else text.index("\n", start)
    body = text[:start] + text[stop:]
    head, _, rest = body.partition("\n")
    file.write_text(f"{head}\n{tank}\n{rest}")
    with pytest.raises(InputError, match=message):
        trials.load_dataset(file)


def test_trials_of_two_tanks_are_not_one_dataset(swum: Dataset, tmp_path: Path) -> None:
    first, second = swum.trials
    mixed = replace(swum, trials=(first, replace(second, tank=Tank((-2.0, 31.0), (-3.0, 4.0)))))
    with pytest.raises(InputError, match="different tanks"):
        trials.save(mixed, tmp_path / "data")


def test_a_fish_cannot_be_generated_through_a_wall(pike: Fish) -> None:
    with pytest.raises(InputError, match="through a wall"):
        generate(pike, ["v1"], duration=4.0, tank=Tank((-1.0, 0.2), (-1.0, 1.0)))
    with pytest.raises(InputError, match="1 places for 2 trials"):
        generate(pike, ["v1", "v3"], duration=1.0, places=[(0.0, 0.0, 0.0)])
