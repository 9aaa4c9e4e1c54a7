"""Kirchhoff's water keeps energy and impulse, of a free body and of a free chain in three dimensions."""

from __future__ import annotations

import numpy as np
import pytest
from wet_models import RK4_ORDER, skip_without_fourth_order

from mjfish.mujoco.coupling_choice import Coupling
from proofs import conservation, parts, trees

FREE = {"body": (trees.CROOKED,), "chain": trees.chain()}


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("current", [False, True], ids=["still", "current"])
@pytest.mark.parametrize("name", FREE)
def test_energy_and_impulse_stay_but_for_rk4s_error(name: str, current: bool, coupling: Coupling) -> None:
    """Four halvings of the step; in a current, as the drifting frame sees it.

    Catches any wrong term of the force that does work or pushes: the gyroscopic and Munk moments, A b, roll.
    """
    skip_without_fourth_order()
    found = conservation.drifts(FREE[name], coupling, current=current)
    assert found.relative[-1].max() < 1e-11
    np.testing.assert_allclose(found.orders, 4.0, atol=0.15)


@pytest.mark.parametrize("integrator", [name for coupling, name in parts.VALID if coupling == "inertia"])
def test_other_integrators_lose_no_more_than_their_order(integrator: str) -> None:
    """First order, for a body alone; RK4 as above."""
    found = conservation.drifts(FREE["body"], "inertia", integrator=integrator, steps=(4e-3, 2e-3, 1e-3))
    np.testing.assert_allclose(found.orders, RK4_ORDER if integrator == "RK4" else 1.0, atol=0.15)


def test_slices_for_themselves_do_not_keep_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without Munk moment: if nothing were lost, the test above would not see the Munk moment."""
    one = conservation.drifts(FREE["body"], "inertia", steps=(1e-3,)).relative[0, 0]
    without = parts.with_water
    monkeypatch.setattr(parts, "with_water", lambda tree, **new: without(tree, **{**new, "munk_moment": 0.0}))
    assert conservation.drifts(FREE["body"], "inertia", steps=(1e-3,)).relative[0, 0] > 1e5 * one
