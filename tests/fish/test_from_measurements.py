"""A first fish from a few measurements."""

from __future__ import annotations

import numpy as np
import pytest

import mjfish
from mjfish.fish import Fish
from mjfish.fish.body_summary import summarise

JOINTS = (1, 2, 5, 9, 20)


def _fish(joints: int) -> Fish:
    return mjfish.new_fish("mine", length=0.5, mass=1.2, joints=joints, height=0.08)


@pytest.mark.parametrize("joints", JOINTS)
def test_it_has_the_measurements(joints: int) -> None:
    fish = _fish(joints)
    assert fish.joints == joints
    assert fish.length == pytest.approx(0.5)
    assert sum(link.mass for link in fish.links) == pytest.approx(1.2)
    assert max(max(section.height) for section in fish.sections[:-1]) == pytest.approx(0.08)
    assert fish.groups == (("head", "tail") if joints == 1 else ("head", "body", "tail"))


@pytest.mark.parametrize("joints", JOINTS)
def test_it_swims_ahead(joints: int) -> None:
    run = mjfish.simulate(_fish(joints), "v1", duration=4.0)
    assert run.status == "ok"
    assert run.velocity[200:, 0].mean() > 0.02


@pytest.mark.parametrize("joints", JOINTS)
def test_a_turn_turns_it(joints: int) -> None:
    straight, turned = (mjfish.simulate(_fish(joints), mode, duration=8.0) for mode in ("v3", "v3-t1"))
    assert np.abs(turned.pose[-1, 2] - straight.pose[-1, 2]) > 0.1


@pytest.mark.parametrize("joints", JOINTS)
def test_nothing_is_odd_about_it_where_it_floats(joints: int) -> None:
    fish = _fish(joints)
    displaced = sum(link.displaced for link in summarise(fish).links)
    floating = mjfish.new_fish("mine", length=0.5, mass=displaced, joints=joints, height=0.08)
    assert summarise(floating).odd == ()


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"joints": 0}, "joints: found 0, expected 1 to 20"),
        ({"joints": 21}, "joints: found 21, expected 1 to 20"),
        ({"length": -1.0}, "length: found -1 m, expected a number above 0"),
        ({"mass": float("nan")}, "mass: found nan kg, expected a number above 0"),
        ({"height": 80.0}, "height: found 80 m, more than the length of 0.5 m; give both in metres"),
    ],
)
def test_measurements_that_no_fish_has_are_refused(wrong: dict[str, float], complaint: str) -> None:
    given = {"length": 0.5, "mass": 1.2, "joints": 3, "height": 0.08, **wrong}
    with pytest.raises(mjfish.MjfishError, match=complaint):
        mjfish.new_fish("mine", **given)  # type: ignore[arg-type]
