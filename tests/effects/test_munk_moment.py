"""Munk moment as a cause."""

from __future__ import annotations

import numpy as np

from mjfish import ode
from mjfish.data import Trial
from mjfish.drive.motion import JointMotion
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

MUNK = find("munk_moment")


def test_kappa_adds_to_the_fishs_own_share(pike: Fish, turning: Trial) -> None:
    half, whole = (pike.model_copy(update={"munk_moment": kappa}) for kappa in (0.25, 0.75))
    model = Model(half, (MUNK,))
    found = model.predict(turning, model.values({"munk_moment.kappa": 0.5})).velocity
    assert found.tobytes() == Model(whole).predict(turning, Model(whole).values()).velocity.tobytes()
    assert found.tobytes() != Model(half).predict(turning, Model(half).values()).velocity.tobytes()


def test_a_stretched_fish_in_oblique_motion_is_turned_broadside(pike: Fish) -> None:
    """Coasting forward and to port, the head falls off to starboard: away from the direction of motion.

    Catches a moment of the wrong sign, which would steer the fish into its motion.
    """
    free = pike.with_values({"c_m.head": 1.0, "c_m.body": 1.0, "c_m.tail": 1.0})
    joints = np.zeros((100, 3, 4))
    motion = JointMotion(readonly(np.linspace(0.0, 0.1, 101)), joints, joints, joints)
    start = np.array([0.5, 0.05, 0.0])
    turned = [
        ode.simulate(MUNK.body(free, {"kappa": kappa}), motion, velocity=start).state[-1, 1, 2] for kappa in (0.0, 1.0)
    ]
    assert turned[1] < turned[0] - 0.01
