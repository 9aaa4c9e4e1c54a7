"""The force in space once more, from slices of water that share no formula with it."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.mujoco.coupling_choice import Coupling
from proofs import derivation


@pytest.mark.parametrize("kappa", [0.0, 0.4, 1.0])
def test_added_mass_force_is_minus_the_rate_of_the_slices_momentum(kappa: float) -> None:
    """Catches any wrong sign or swap in the inertial, gyroscopic and Munk terms, of either axis and of roll."""
    assert derivation.inertial_difference(kappa) < 1e-9


@pytest.mark.parametrize(("roots", "median", "worst"), [(0, 1e-11, 1e-9), (1, 1e-5, 2e-3), (2, 1e-4, 3e-3)])
def test_drag_is_the_integral_over_the_slices(roots: int, median: float, worst: float) -> None:
    """Gauss strips are worst where both components change sign on the link.

    Catches a moment about the wrong axis, height for width, |q_y| for |q|.
    """
    found = derivation.drag_differences(roots)
    assert np.median(found) < median
    assert found.max() < worst


def test_without_heave_pitch_and_roll_the_drag_is_that_of_the_plane() -> None:
    """To the last bit: the planar fish swims as before."""
    assert derivation.planar_difference() == 0.0


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_chain_in_a_current_balances_against_slices(coupling: Coupling) -> None:
    """The acceleration that MuJoCo finds, against slices that follow it, body by body.

    Catches what a comparison with our own dense solution cannot: a Jacobian, a bias acceleration or a current that is
    wrong in both.
    """
    assert derivation.balance(coupling, c_d=0.0) < 1e-9
    assert derivation.balance(coupling) < 5e-6  # Gauss strips of the drag
