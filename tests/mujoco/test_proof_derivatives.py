"""MuJoCo's derivatives of the step see the water; its inverse dynamics does not."""

from __future__ import annotations

import mujoco
import pytest

from mjfish.mujoco.coupling_choice import Coupling
from proofs import derivatives, integrator_steps, parts, trees

DIFFERENTIATED = [one for one in integrator_steps.DAMPED if one[1] != "RK4"]


@pytest.mark.parametrize(("coupling", "integrator", "euler_damp"), DIFFERENTIATED)
def test_transition_matrices_are_the_slopes_of_the_step(coupling: Coupling, integrator: str, euler_damp: bool) -> None:
    """A and B against centred differences of mj_step of another width.

    Catches water that lags, or that keeps something from one evaluation to the next.
    """
    assert derivatives.transition_difference(coupling, integrator, euler_damp=euler_damp) < 1e-7


def test_mujoco_has_no_transition_matrices_of_rk4() -> None:
    """Said in the docs; a MuJoCo that has them gets a row of its own."""
    with pytest.raises(mujoco.FatalError, match="RK4"):
        derivatives.transition_difference("inertia", "RK4")


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_inverse_dynamics_lacks_the_water_until_it_is_taken_off(coupling: Coupling) -> None:
    """Said in the docs: `qfrc_inverse` holds the water's force; less `wrenches`, it is what was applied."""
    found = derivatives.inverse(coupling)
    assert found.applied > 0.1
    assert found.corrected < 1e-12
    assert found.rigid < 1e-6
    assert found.wet > 0.1


def test_the_chain_has_water_enough_to_see() -> None:
    """Catches proofs that prove nothing because their water is thin."""
    model = parts.spec(trees.chain()).compile()
    parts.wet(model, trees.chain())
    data = mujoco.MjData(model)
    parts.stir(model, data)
    exact = derivatives.equation(model, data)
    assert abs(exact.added).max() > 0.5 * abs(exact.rigid).max()
