"""The head's centre of mass."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Dataset, Trial
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.hydro.link import link_records

COM = find("com_offset")


def test_only_the_heads_centre_of_mass_moves_towards_the_tail(pike: Fish) -> None:
    """By the parallel-axis theorem its inertia about the nose grows by m (2 c d + d^2): the one about it stays."""
    other = COM.body(pike, {"shift": 0.02})
    assert other.links[1:] == pike.links[1:]
    assert other.links[0] == pike.links[0].model_copy(update={"com": 0.18 + 0.02})
    before, after = ((r["inertia"] + r["mass"] * r["com"] ** 2)[0] for r in map(link_records, (pike, other)))
    np.testing.assert_allclose(after - before, 1.528 * (2 * 0.18 * 0.02 + 0.02**2), rtol=1e-12)


def test_the_centre_of_mass_stays_inside_the_head(pike: Fish) -> None:
    """Of the pike, and of one whose centre of mass is near an end; one that has it outside is refused."""
    trial = Trial("run", None, np.linspace(0.0, 1.0, 51), np.zeros((51, 3)), joint_angle=np.zeros((51, 4)))
    for com, reach in ((0.18, 0.08), (0.05, 0.0475), (0.25, 0.039)):
        edge = pike.links[0].model_copy(update={"com": com})
        fish = pike.model_copy(update={"links": (edge, *pike.links[1:])})
        effect = COM.for_fish(fish)
        assert effect is not None
        assert effect.not_applicable(Dataset("d", fish, (trial,))) == ""
        assert effect.parameters[0].high == pytest.approx(reach, rel=0.02)
        for bound in (effect.parameters[0].low, effect.parameters[0].high):
            assert 0.0 < effect.body(fish, {"shift": bound}).links[0].com < edge.length
    outside = pike.links[0].model_copy(update={"com": 0.3})
    fish = pike.model_copy(update={"links": (outside, *pike.links[1:])})
    assert COM.for_fish(fish) is None
    assert "is not inside its 0.291 m" in COM.not_applicable(Dataset("d", fish, (trial,)))


def test_the_bounds_of_another_fish_are_in_proportion(pike: Fish) -> None:
    small = pike.links[0].model_copy(update={"length": 0.0291, "com": 0.018})
    effect = COM.for_fish(pike.model_copy(update={"links": (small, *pike.links[1:])}))
    assert effect is not None
    assert effect.parameters[0].high == pytest.approx(0.008)
    assert effect.parameters[0].scale == pytest.approx(0.00049, rel=0.02)
