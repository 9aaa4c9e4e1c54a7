"""F / (m + m_A): a plate that is pushed or turned from rest, against closed forms."""

from __future__ import annotations

import pytest

from mjfish.mujoco.coupling_choice import Coupling
from proofs import closed_forms
from proofs.parts import VALID


@pytest.mark.parametrize(("coupling", "integrator"), VALID)
@pytest.mark.parametrize("c_m", [0.06, 1.0, 30.0])
def test_pushed_plate_accelerates_with_its_added_mass(c_m: float, coupling: Coupling, integrator: str) -> None:
    """Along none, across height and width each its own, I + j in roll, and about a com that is ahead or below.

    Catches height taken for width, a wrong factor of the roll inertia, an arm about the wrong point, added mass that a
    coupling or an integrator leaves out.
    """
    found = closed_forms.difference(c_m, coupling, integrator)
    assert len(found) == 8
    assert max(found.values()) < 1e-12, found


def test_the_closed_forms_differ_from_each_other() -> None:
    """Were the three accelerations alike, the test above could not tell the axes apart."""
    found = dict(closed_forms.pushes(1.0))
    along, height, width = (abs(found[name].linear).max() for name in ("along", "across height", "across width"))
    assert along > 1.3 * width > 1.3 * 1.3 * height
