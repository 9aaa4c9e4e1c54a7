"""Joint limits, frictionloss and a contact in water."""

from __future__ import annotations

import pytest

from mjfish.errors import InputError
from proofs import constraints, parts, trees


@pytest.mark.parametrize("case", constraints.CASES)
@pytest.mark.parametrize(("solver", "tolerance"), [("Newton", 1e-12), ("CG", 1e-6)])
def test_motion_under_constraints_balances_with_the_added_mass(case: str, solver: str, tolerance: float) -> None:
    """(M + M_a) q'' = force + J^T f, and f as MuJoCo's law has it for that q''.

    Catches a solver that works with the inertia without water.
    """
    found = constraints.balance(case, solver)
    assert found.active >= 6  # in six states
    assert found.balance < tolerance
    assert found.law < 1e-9


@pytest.mark.parametrize("case", constraints.CASES)
def test_what_would_be_wrong_under_constraints_is_refused(case: str) -> None:
    """Coupling xfrc with constraints, and PGS, each with its remedy; and each would indeed be wrong."""
    with pytest.raises(InputError, match=r'use coupling="inertia"'):
        parts.wet(constraints.model(case), trees.chain(), "xfrc")
    with pytest.raises(InputError, match=r'set solver="Newton" or "CG"'):
        parts.wet(constraints.model(case, "PGS"), trees.chain(), "inertia")
    with pytest.raises(InputError, match="PGS"):
        parts.wet(constraints.model(case, "PGS"), trees.chain(), None)
    assert parts.wet(constraints.model(case), trees.chain(), None).coupling == "inertia"
    assert constraints.balance(case, "Newton").xfrc > 0.1
    assert constraints.pgs_error(case) > 0.01
