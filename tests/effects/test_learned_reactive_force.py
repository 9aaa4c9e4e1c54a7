"""Shares of the added momentum: one after the other they are the formulas of their mechanism."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import LINKS, STATES, force, moving

from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.hydro.force import gyroscopic

LEARNED = find("reactive_force")


@pytest.mark.parametrize(("name", "short"), [("axial_momentum", "axial"), ("edge_momentum", "edge")])
def test_a_share_alone_is_the_formula(pike: Fish, name: str, short: str) -> None:
    for state in STATES:
        records = moving(pike, state)
        for link in LINKS:
            formula = force(find(name), {"share": 0.7}, records, link)
            np.testing.assert_allclose(force(LEARNED, {short: 0.7}, records, link), formula, rtol=1e-13, atol=0.0)


def test_both_munk_shares_are_the_munk_moment_of_the_model(pike: Fish) -> None:
    for state in STATES:
        records = moving(pike, state)
        without = [np.array(gyroscopic(record)) for record in records]
        records["munk"] = 0.8
        for link in LINKS:
            found = force(LEARNED, {"munk_body": 0.8, "munk_tail": 0.8}, records, link)
            np.testing.assert_allclose(found, gyroscopic(records[link]) - without[link], rtol=1e-12, atol=1e-16)


def test_shares_add_up(pike: Fish) -> None:
    values = {"munk_body": 0.5, "munk_tail": -0.3, "axial": 0.4, "edge": 0.9}
    records = moving(pike, STATES[1])
    for link in LINKS:
        each = [force(LEARNED, {short: value}, records, link) for short, value in values.items()]
        np.testing.assert_allclose(force(LEARNED, values, records, link), np.sum(each, axis=0), rtol=1e-12, atol=1e-15)
