"""Added mass from a tenth to a hundred times the mass, beside the scheme that lags a step."""

from __future__ import annotations

import pytest

from mjfish.mujoco.coupling_choice import Coupling
from proofs import lagged_added_mass


@pytest.mark.parametrize("ratio", [0.1, 3.0, 100.0])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_any_added_mass_is_exact_and_stable(coupling: Coupling, ratio: float) -> None:
    """Catches a lag of a step, and an explicit part that grows with the added mass."""
    run = lagged_added_mass.run(ratio, coupling, steps=120)
    assert run.diverged == -1
    assert run.error < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("ratio", lagged_added_mass.RATIOS)
@pytest.mark.parametrize(
    ("coupling", "integrator"),
    [("inertia", "Euler"), ("inertia", "discrete"), ("inertia", "implicit"), ("xfrc", "Euler")],
)
def test_long_runs_are_exact_and_stable(coupling: Coupling, integrator: str, ratio: float) -> None:
    """Euler: the step is the acceleration; the others keep a body's own gyroscopic terms implicit, an error of O(h)."""
    run = lagged_added_mass.run(ratio, coupling, integrator, steps=2000)
    assert run.diverged == -1
    assert run.error < (1e-11 if integrator == "Euler" else 0.02)


@pytest.mark.parametrize(("ratio", "grows"), [(0.9, False), (1.1, True), (3.0, True)])
def test_a_lagged_scheme_diverges_above_the_mass_of_the_body(ratio: float, grows: bool) -> None:
    """What we do not do; the bound is 1, whatever the step."""
    run = lagged_added_mass.run(ratio, None, steps=200)
    assert (run.diverged >= 0) is grows
    assert grows or 1e-3 < run.error < 0.05  # settles, but lags
