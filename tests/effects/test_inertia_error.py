"""Yaw inertias of the links."""

from __future__ import annotations

import numpy as np

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model

INERTIA = find("inertia_error")


def test_every_inertia_about_the_centre_of_mass_grows_and_the_rest_stays(pike: Fish) -> None:
    other = INERTIA.body(pike, {"error": 0.5})
    for before, after in zip(pike.links, other.links, strict=True):
        assert after == before.model_copy(update={"inertia": 1.5 * before.inertia})
    assert other.model_copy(update={"links": pike.links}) == pike
    assert hash(other) != hash(pike)


def test_a_larger_inertia_turns_less_within_the_beat(pike: Fish) -> None:
    """The head yaws less against its tail. Catches an error with its sign turned."""
    time = np.arange(301) / 50.0
    trial = Trial("v3", None, time, np.zeros((301, 3)), drive=modes.drive("v3"))
    model = Model(pike, (INERTIA,))
    yaw = [
        np.std(model.predict(trial, model.values({"inertia_error.error": error})).velocity[150:, 2])
        for error in (-0.5, 0.0, 1.0)
    ]
    assert yaw[0] > 1.02 * yaw[1] > 1.02 * 1.02 * yaw[2]
