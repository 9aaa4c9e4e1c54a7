"""A plan for a fish of any number of joints."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.design import plan
from mjfish.design.menu import Menu
from mjfish.fish.from_measurements import new_fish
from mjfish.simulation import generate


@pytest.mark.parametrize(
    "joints", [pytest.param(1, marks=pytest.mark.slow), 2, 5, pytest.param(9, marks=pytest.mark.slow)]
)
def test_every_joint_has_a_zero_whose_visible_size_shrinks(joints: int) -> None:
    fish = new_fish("any", length=0.4, mass=0.5, joints=joints, height=0.08)
    dataset = generate(fish, ["v1", "v3"], noise=(0.01, 0.01, 0.05), duration=3.0, seed=3)
    found = plan(dataset, causes=("joint_zero_offset", "time_offset"), menu=Menu(3.0), jobs=1)
    zeros = {f"joint_zero_offset.joint_{k + 1}" for k in range(joints)}
    assert found.runs
    for option in found.runs:
        hardest, clock = (pair.first for pair in option.pairs)
        assert hardest in zeros
        assert clock == "time_offset.offset"
        assert all(0.0 < pair.after < pair.now < np.inf for pair in option.pairs)
