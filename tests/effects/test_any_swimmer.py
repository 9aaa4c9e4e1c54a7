"""Every cause acts on a fish of one joint, of two, of five and of nine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset, Trial
from mjfish.drive import modes
from mjfish.effects import catalogue, of_fish
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.mujoco import StripFluid, export
from mjfish.numerics.arrays import readonly

JOINTS = (1, *(pytest.param(joints, marks=pytest.mark.slow) for joints in (2, 5)), 9)


@pytest.fixture(scope="module", params=JOINTS, ids=["1 joint", "2 joints", "5 joints", "9 joints"])
def swimmer(request: pytest.FixtureRequest) -> Fish:
    """A fish of this many joints."""
    return mjfish.new_fish("swimmer", length=0.4, mass=0.7, joints=request.param, height=0.08)


@pytest.fixture
def trial(swimmer: Fish) -> Trial:
    """A run of known pose in a tank, with a turn in it."""
    pool = mjfish.generate(
        swimmer, ["v3-t1"], duration=6.0, places=[(0.0, 0.0, 0.3)], effects=[], noise=(1e-6, 1e-6, 1e-6)
    )
    return replace(pool.trials[0], roll=readonly(0.1 * np.sin(3.0 * pool.trials[0].time)))


def test_every_cause_acts_on_it(swimmer: Fish, trial: Trial) -> None:
    nominal = Model(swimmer).predict(trial, Model(swimmer).values()).velocity
    dataset = Dataset("d", swimmer, (trial,))
    idle = []
    for name, effect in of_fish(catalogue(), swimmer).items():
        if effect.not_applicable(dataset):
            continue
        model = Model(swimmer, (effect,))
        p = effect.amplitudes()[0]
        size = p.start if p.start != p.default else min(p.default + 3.0 * p.scale, p.high)
        moved = model.predict(trial, model.values({p.name: size}))
        assert moved.status == "ok", (name, moved.message)
        slopes = sensitivities(model, trial, model.values({p.name: size}), [p.name])
        assert np.all(np.isfinite(slopes)), name
        if not np.abs(moved.velocity - nominal).max() > 0.0:
            idle.append(name)
    assert idle == []


def test_it_swims_alike_in_mujoco(swimmer: Fish) -> None:
    found = mjfish.check(swimmer, "v3-t1", duration=6.0, halvings=1)
    assert found.passed, str(found)


def test_its_model_is_exported_with_its_water(swimmer: Fish, tmp_path: Path) -> None:
    export.write(tmp_path / "fish.xml", swimmer)
    fluid = StripFluid(mujoco.MjModel.from_xml_path(str(tmp_path / "fish.xml")))
    assert [link.c_d for link in fluid.links] == [swimmer.values[f"c_d.{link.group}"] for link in swimmer.links]


def test_modes_are_those_of_the_pike_stretched(swimmer: Fish) -> None:
    last = modes.drive("v3-t2", swimmer.joints)[-1].bias
    assert len(last) == swimmer.joints
    assert last[-1] == 2.0
    assert swimmer.joints == 1 or last[0] == 0.0
    assert modes.drive("v3-t2")[-1].bias == modes.drive("v3-t2", 4)[-1].bias == (0.0, 1.0, 1.5, 2.0)
