"""The head's centre of mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects import find
from mjfish.fish import Fish, load_fish
from mjfish.hydro.link import link_records

COM = find("com_offset")


def test_only_the_heads_centre_of_mass_moves_towards_the_tail(pike: Fish) -> None:
    """By the parallel-axis theorem its inertia about the nose grows by m (2 c d + d^2): the one about it stays."""
    other = COM.body(pike, {"shift": 0.02})
    assert other.links[1:] == pike.links[1:]
    assert other.links[0] == pike.links[0].model_copy(update={"com": 0.18 + 0.02})
    before, after = ((r["inertia"] + r["mass"] * r["com"] ** 2)[0] for r in map(link_records, (pike, other)))
    np.testing.assert_allclose(after - before, 1.528 * (2 * 0.18 * 0.02 + 0.02**2), rtol=1e-12)


def test_every_shipped_fish_keeps_its_centre_of_mass_inside_the_head_and_a_short_head_is_refused() -> None:
    trial = Trial("run", None, np.linspace(0.0, 1.0, 51), np.zeros((51, 3)), joint_angle=np.zeros((51, 4)))
    pike = load_fish("pike")
    dataset = Dataset("d", pike, (trial,))
    assert COM.not_applicable(dataset) == ""
    for high in (COM.parameters[0].low, COM.parameters[0].high):
        moved = COM.body(pike, {"shift": high}).links[0]
        assert 0.0 < moved.com < moved.length
    for com in (0.05, 0.25):
        edge = pike.links[0].model_copy(update={"com": com})
        short = pike.model_copy(update={"links": (edge, *pike.links[1:])})
        assert "leave the head, 0.291 m long" in COM.not_applicable(replace(dataset, fish=short))
