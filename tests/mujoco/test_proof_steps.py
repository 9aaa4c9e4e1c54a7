"""Every integrator's own step, with damping, springs, servos and water, and where its runs end."""

from __future__ import annotations

import pytest
from wet_models import skip_without_fourth_order

from mjfish.errors import InputError
from mjfish.mujoco import StripFluid
from mjfish.mujoco.coupling_choice import Coupling
from proofs import integrator_steps, trees


@pytest.mark.parametrize("integrator", integrator_steps.ONE_STEP)
@pytest.mark.parametrize("tree", [(trees.CROOKED,), trees.chain()], ids=["body", "chain"])
def test_step_solves_the_integrators_equation_with_the_added_mass(
    tree: tuple[trees.Part, ...], integrator: str
) -> None:
    """(v+ - v) / h = (M + M_a + h D + h^2 K)^-1 (...), dense.

    Catches an implicit solve with an inertia that lacks the water, which changes the thrust of a swimmer.
    """
    assert integrator_steps.step_difference(tree, integrator) < 1e-12


@pytest.mark.parametrize(("coupling", "integrator", "euler_damp"), integrator_steps.DAMPED)
def test_runs_approach_one_trajectory_at_the_integrators_order(
    coupling: Coupling, integrator: str, euler_damp: bool
) -> None:
    """Catches a force at the wrong stage of RK4, a stale state, a consistent but wrong implicit term."""
    if integrator == "RK4":
        skip_without_fourth_order()
    order, error = integrator_steps.convergence(coupling, integrator, euler_damp=euler_damp)
    assert order == pytest.approx(4.0 if integrator == "RK4" else 1.0, abs=0.15 if integrator == "RK4" else 0.05)
    assert error < (1e-7 if integrator == "RK4" else 0.03)


@pytest.mark.parametrize("integrator", integrator_steps.ONE_STEP)
def test_forces_alone_are_refused_where_damping_is_implicit_and_would_be_wrong(integrator: str) -> None:
    """Were the error small, the refusal would be a nuisance."""
    model = integrator_steps.model(trees.chain(), integrator, 2e-3)
    links = [{"body": part.name, **strip} for part in trees.chain() for strip in part.strips]
    with pytest.raises(InputError, match=r'use coupling="inertia"'):
        StripFluid(model, links, coupling="xfrc")
    assert StripFluid(model, links).coupling == "inertia"
    assert integrator_steps.refused_difference(integrator) > 0.02
