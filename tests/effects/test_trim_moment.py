"""A moment that turns the fish to one side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recovery import deviations, refitted, strength, synthetic

from mjfish.data import Trial
from mjfish.drive.wave import Wave
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray

TRIM = find("trim_moment")
#: A stretched fish.
STILL = Wave(1.0, (0.0,) * 4, (0.0,) * 4, (0.0,) * 4, ramp=0.5)


def _predict(fish: Fish, trial: Trial, velocity: FloatArray | None = None, **sizes: float) -> FloatArray:
    model = Model(fish, (TRIM,))
    values = {f"trim_moment.{short}": size for short, size in sizes.items()}
    return model.predict(trial, model.values(values), velocity=velocity).velocity


def test_a_stretched_fish_begins_to_turn_by_the_moment_over_the_inertia(pike: Fish, straight: Trial) -> None:
    """To port, with the inertia of rigid links in a row and their water about the centre of mass of all."""
    trial, moment = replace(straight, drive=(), wave=STILL), 1e-4
    bare = pike.model_copy(update={"density": 1e-9})
    turned = _predict(bare, trial, constant=moment)
    fronts = np.concatenate([[0.0], np.cumsum([link.length for link in bare.links])[:-1]])
    mass = np.array([link.mass for link in bare.links])
    place = fronts + [link.com for link in bare.links]
    middle = mass @ place / mass.sum()
    inertia = sum(link.inertia for link in bare.links) + mass @ (place - middle) ** 2
    np.testing.assert_allclose(turned[1:, 2], moment / inertia * trial.time[1:], rtol=1e-5)


def test_the_part_of_the_speed_goes_with_its_square(pike: Fish, straight: Trial) -> None:
    """Of a stretched fish that glides, at the start; none of it at rest."""
    trial = replace(straight, drive=(), wave=replace(STILL, ramp=0.0))
    turns = []
    for speed in (0.4, 0.8):
        begun = np.array([speed, 0.0, 0.0])
        turns.append(
            _predict(pike, trial, begun, square=0.002)[1, 2] / _predict(pike, trial, begun, constant=0.002)[1, 2]
        )
    assert turns == pytest.approx([0.16, 0.64], rel=0.03)
    assert not _predict(pike, replace(straight, drive=(), wave=STILL), square=0.1).any()


def test_hidden_moments_are_found_again(pike: Fish) -> None:
    sizes = {"constant": 0.02, "square": -0.04}
    assert strength(pike, TRIM, sizes) > 1.0
    found = refitted(synthetic(pike, TRIM, sizes), TRIM)
    assert found.status == "converged"
    assert max(map(abs, deviations(found, TRIM, sizes).values())) < 4.0
