"""Every cause acts on a fish of any number of joints and links."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Sensor, Tank, Trial
from mjfish.drive.wave import Wave
from mjfish.effects import Effect, catalogue
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly


def _fish(pike: Fish, joints: int) -> Fish:
    """Return the pike with its body in another number of links of the same length, mass and inertia per length."""
    head, *body, tail = pike.links
    length, mass = (sum(getattr(link, name) for link in body) for name in ("length", "mass"))
    if (count := joints - 1) == 0:
        return pike.model_copy(
            update={"links": (head.model_copy(update={"length": head.length + length}), tail), "cpg": None}
        )
    each = {"length": length / count, "mass": mass / count, "com": 0.5 * length / count, "inertia": 1e-3 / count**3}
    links = [body[0].model_copy(update={"name": f"body_{k}", **each}) for k in range(count)]
    return pike.model_copy(update={"links": (head, *links, tail), "cpg": None})


@pytest.mark.parametrize("joints", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 5)), 9])
@pytest.mark.parametrize("effect", catalogue().values(), ids=catalogue())
def test_it_changes_a_swim_and_stays_finite(pike: Fish, effect: Effect, joints: int) -> None:
    """Catches a cause that counts on five links, or on four joints."""
    fish = _fish(pike, joints)
    wave = Wave(1.5, (0.5 / joints,) * joints, tuple(-0.5 * k for k in range(joints)), (0.05,) * joints, ramp=0.3)
    time = readonly(np.arange(0.0, 1.0, 0.02))
    still, roll = readonly(np.zeros((len(time), 3))), readonly(0.1 * np.sin(9.0 * time))
    tank = Tank((-0.3, 2.0), (-0.3, 0.3))
    place = Sensor("position", "position", time, still[:, :2])
    trial = Trial("any", None, time, still, wave=wave, pose=still, roll=roll, tank=tank, sensors=(place,))
    model = Model(fish, (effect,))
    (own,) = model.effects
    off = {p.name: min(p.default + 3.0 * p.scale, p.high) for p in own.parameters if not p.shape}
    nominal, changed = (model.predict(trial, model.values(values)) for values in ({}, off))
    assert changed.status == "ok"
    assert np.all(np.isfinite(changed.velocity))
    assert np.all(np.isfinite(changed.sensors[0]))
    same = np.array_equal(changed.velocity, nominal.velocity) and np.array_equal(changed.sensors[0], nominal.sensors[0])
    assert not same or effect.name == "roll"
