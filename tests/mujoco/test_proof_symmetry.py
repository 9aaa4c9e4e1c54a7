"""What must make no difference: mirror, direction, drift, and how a body's strips are told."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mjfish.mujoco.coupling_choice import Coupling
from proofs import symmetry
from proofs.parts import VALID


@pytest.mark.parametrize(("coupling", "integrator"), VALID)
@pytest.mark.parametrize("of", [symmetry.mirror, symmetry.turned_world, symmetry.drifting])
def test_chain_swims_alike(of: Callable[[Coupling, str], float], coupling: Coupling, integrator: str) -> None:
    """300 steps with gravity, buoyancy, drag and a current.

    Catches a vector that is treated as a pseudovector, an axis of the world in the force, a current that acts but for
    the velocity relative to it.
    """
    assert of(coupling, integrator) < 1e-10


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize(
    ("of", "with_drag"),
    [
        (symmetry.from_the_other_end, 1e-7),  # table of moments
        (symmetry.width_for_height, 1e-12),
        (symmetry.round_section, 5e-5),  # Gauss strips
        (symmetry.in_two_pieces, 5e-5),  # Gauss strips
    ],
)
def test_strips_may_be_told_in_any_way(of: Callable[..., float], with_drag: float, coupling: Coupling) -> None:
    """Catches moments about the wrong end, height and width treated unlike, a drag that knows `up` of a circle."""
    assert of(coupling, drag=False) < 1e-12
    assert of(coupling, drag=True) < with_drag
