"""No public function changes the arrays and tables that a user hands over."""

from __future__ import annotations

import copy
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset, Sensor, save
from mjfish.effects import catalogue, find
from mjfish.inspection import report_on


def _writable(thing: Any) -> Any:
    """Return a trial or a sensor with arrays that can be written to."""
    own = {field.name: getattr(thing, field.name) for field in fields(thing)}
    return replace(thing, **{name: np.array(value) for name, value in own.items() if isinstance(value, np.ndarray)})


@pytest.fixture(scope="module")
def pool() -> Dataset:
    """Runs with a sensor, their arrays such as a user's own are."""
    time = np.arange(61) / 30.0
    tag = Sensor("tag", "position", time, np.zeros((61, 2)), station=0.05, sigma=np.array([0.002, 0.002]))
    made = mjfish.generate("pike", ["v1", "v3", "v5"], sensors=[tag], noise=(0.01, 0.01, 0.05), duration=2.0)
    own = [_writable(replace(trial, sensors=tuple(map(_writable, trial.sensors)))) for trial in made.trials]
    return replace(made, trials=tuple(own))


def _arrays(dataset: Dataset) -> list[Any]:
    things = [thing for trial in dataset.trials for thing in (trial, *trial.sensors)]
    values = [getattr(thing, field.name) for thing in things for field in fields(thing)]
    return [value for value in values if isinstance(value, np.ndarray)]


@pytest.mark.parametrize("call", ["save", "inspect", "report_on", "identify", "diagnose"])
def test_arrays_of_a_dataset_stay(pool: Dataset, call: str, tmp_path: Path) -> None:
    effects = {"time_offset": find("time_offset")}
    calls: dict[str, Any] = {
        "save": lambda: save(pool, tmp_path / "pool"),
        "inspect": lambda: mjfish.inspect(pool),
        "report_on": lambda: report_on(pool).report(tmp_path / "page.html"),
        "identify": lambda: mjfish.identify(pool, starts=1),
        "diagnose": lambda: mjfish.diagnose(pool, effects=effects, jobs=1),
    }
    before, held = copy.deepcopy(_arrays(pool)), dict(effects)
    assert any(array.flags.writeable for array in _arrays(pool))
    calls[call]()
    for after, array in zip(_arrays(pool), before, strict=True):
        np.testing.assert_array_equal(after, array)
    assert effects == held


def test_tables_and_arrays_of_a_simulation_stay() -> None:
    values, noise, modes = (
        {"c_d.tail": 1.3, "servo_lag.time_constant": 0.02},
        np.array([0.01, 0.01, 0.05]),
        ["v1", "v3"],
    )
    known = dict(catalogue())
    given = copy.deepcopy(values), noise.copy(), list(modes), set(known)
    fish = mjfish.load_fish("pike")
    text = fish.model_dump_json()
    mjfish.generate(fish, modes, values=values, effects=known, noise=noise, duration=1.0)
    for engine in ("ode", "mujoco"):
        mjfish.simulate(fish, "v1", engine=engine, values=values, effects=known, duration=1.0)
    assert (values, modes, set(known)) == (given[0], given[2], given[3])
    np.testing.assert_array_equal(noise, given[1])
    assert fish.model_dump_json() == text
