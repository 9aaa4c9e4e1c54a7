"""Drag near the walls of a tank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Dataset, Tank, Trial
from mjfish.effects.wall_effect import WallEffect
from mjfish.fish import Fish
from mjfish.hydro.force import drag
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.simulation.synthetic import generate

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
ON = {"wall_effect.size": 1.5, "wall_effect.reach": 0.2}
TANK = Tank((-5.0, 5.0), (-0.3, 2.0))


@pytest.mark.parametrize(
    ("place", "distance"),
    [((0.0, 0.0), 0.3), ((1.0, 1.5), 0.5), ((-4.6, 1.0), 0.4), ((4.9, 1.0), 0.1), ((0.0, -0.4), 0.0)],
)
def test_the_nearest_wall_counts_from_the_middle_of_the_link(
    pike: Fish, place: tuple[float, float], distance: float
) -> None:
    """Each of the four walls; outside counts as at the wall; half a link behind the joint, along the heading."""
    records = link_records(pike, VALUES)
    link = records[1]
    link["u"], link["v"], link["w"], heading = 0.3, 0.2, -5.0, 0.7
    half = 0.5 * link["length"]
    link["x"], link["y"], link["heading"] = (
        place[0] + half * np.cos(heading),
        place[1] + half * np.sin(heading),
        heading,
    )
    assert WallEffect.load is not None
    numbers = (1.5, 0.2, *WallEffect().constants(_trial(TANK, np.zeros((2, 3)))))
    table = load_rows([(WallEffect.load, numbers)], 5)
    pushed = loads_on(records, 1, 1, table, False, LoadBuffers(np.zeros(ANSWER), np.zeros(8), np.zeros(8)))
    np.testing.assert_allclose(pushed, 1.5 * np.exp(-distance / 0.2) * np.array(drag(link)), rtol=1e-12)


def _trial(tank: Tank | None, pose: np.ndarray | None) -> Trial:
    time = np.array([0.0, 0.02])
    return Trial("one", None, time, np.zeros((2, 3)), pose=pose, tank=tank)


def test_a_wall_beside_the_run_changes_a_synthetic_trial(pike: Fish) -> None:
    """The start in the tank reaches the load, and the poses are those of the run."""
    places = [(0.0, 9.0, 0.2), (0.0, -0.1, 0.2)]
    wide = Tank((-5.0, 40.0), (-0.35, 20.0))
    data = generate(
        pike, ["v3", "v3"], values=VALUES | ON, effects=[WallEffect()], duration=4.0, tank=wide, places=places
    )
    middle, wall = data.trials
    assert middle.pose is not None
    assert wall.pose is not None
    np.testing.assert_allclose(wall.pose[0], places[1], rtol=0.0, atol=1e-12)
    moved = np.gradient(wall.pose[:, 0], wall.time)[50:-1]
    along = wall.velocity[:, 0] * np.cos(wall.pose[:, 2]) - wall.velocity[:, 1] * np.sin(wall.pose[:, 2])
    assert np.abs(moved - along[50:-1]).max() < 0.1 * np.abs(along).max()
    nearest = wide.distance(wall.pose)
    assert 0.0 < nearest.min() < 0.25
    close = int(np.argmin(nearest))
    assert np.abs(wall.velocity - middle.velocity)[close : close + 25, 2].max() > 0.1
    again = Model(pike, (WallEffect(),), step=0.001).predict(wall, VALUES | ON)
    np.testing.assert_allclose(again.velocity, wall.velocity, rtol=0.0, atol=1e-12)


def test_its_derivatives(pike: Fish, turning: Trial) -> None:
    """By size, reach and a coefficient, which also moves the fish nearer to the wall or away."""
    trial = replace(
        turning, pose=np.tile([0.0, 0.05, -0.1], (len(turning.time), 1)), tank=Tank((-1.4, 30.0), (-1.7, 8.0))
    )
    model = Model(pike, (WallEffect(),))
    values = VALUES | {"wall_effect.size": 0.8, "wall_effect.reach": 0.3}
    names = ["wall_effect.size", "wall_effect.reach", "c_d.tail", "start.surge"]
    found = sensitivities(model, trial, values, names, velocity=np.zeros(3))
    for k, name in enumerate(names[:3]):
        h = 1e-3 * values[name]
        at = lambda v, name=name: model.predict(trial, values | {name: v}, velocity=np.zeros(3)).velocity  # noqa: E731
        here = values[name]
        by = (8.0 * (at(here + h) - at(here - h)) - at(here + 2 * h) + at(here - 2 * h)) / (12.0 * h)
        np.testing.assert_allclose(found[:, :, k], by, rtol=0.0, atol=3e-6 * np.abs(by).max())
    null = VALUES | {"wall_effect.size": 0.0, "wall_effect.reach": 0.3}
    at_null = sensitivities(model, trial, null, names[:2], velocity=np.zeros(3))
    h = 1e-3
    by = (
        model.predict(trial, null | {"wall_effect.size": h}, velocity=np.zeros(3)).velocity
        - model.predict(trial, null | {"wall_effect.size": -h}, velocity=np.zeros(3)).velocity
    ) / (2.0 * h)
    np.testing.assert_allclose(at_null[:, :, 0], by, rtol=0.0, atol=1e-4 * np.abs(by).max())
    assert not at_null[:, :, 1].any()


def test_without_tank_or_place_it_says_so(pike: Fish) -> None:
    effect, here = WallEffect(), np.zeros((2, 3))
    of = lambda *trials: Dataset("d", pike, trials)  # noqa: E731
    assert "tank" in effect.not_applicable(of(_trial(None, here)))
    assert "not measured" in effect.not_applicable(of(_trial(TANK, None), _trial(TANK, here)))
    unplaced = np.array([[np.nan, np.nan, 0.1]] * 2)
    assert "not measured" in effect.not_applicable(of(_trial(TANK, unplaced)))
    assert "nearer to a wall than 40 m" in effect.not_applicable(of(_trial(Tank((-90.0, 90.0), (-40.0, 90.0)), here)))
    assert effect.not_applicable(of(_trial(TANK, here))) == ""
