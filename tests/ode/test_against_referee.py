"""The compiled equation against the slow second referee, which integrates total momentum."""

from __future__ import annotations

import numpy as np
import pytest
import referee
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish

STRAIGHT = (0.0, 0.0, 0.0, 0.0)
#: The mode changes of Table IV, brought forward so that both sides of the jump are short.
JUMPS = {
    "v1": modes.drive("v1"),
    "v5-v1": (DriveSegment(0.0, 26.0, STRAIGHT), DriveSegment(0.4, 18.0, STRAIGHT)),
    "v3-t2": (DriveSegment(0.0, 22.0, STRAIGHT), DriveSegment(0.4, 22.0, (0.0, 1.0, 1.5, 2.0))),
    "three": (
        DriveSegment(0.0, 18.0, (0.0, 0.5, 1.0, 1.5)),
        DriveSegment(0.25, 30.0, STRAIGHT),
        DriveSegment(0.51, 20.0, (-1.0, 0.0, 0.0, 2.0)),
    ),
}
COEFFICIENT_SETS = {
    "published": (0.01, 0.07, 0.06, 4.0, 1.5, 2.5, 0.02, 0.02, 0.02),
    "alternative": (3.0, 0.01, 0.40, 4.0, 0.1, 0.18, 0.02, 0.010, 0.009),
    "unit": (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.01, 0.01, 0.01),
}


def _fish(fish: Fish, coefficients: str, **changes: float) -> Fish:
    values = dict(zip(COEFFICIENTS, COEFFICIENT_SETS[coefficients], strict=True))
    return fish.with_values(values).model_copy(update=changes)


def _worst(fish: Fish, drive: tuple[DriveSegment, ...], duration: float) -> float:
    time = np.linspace(0.0, duration, round(duration / 0.01) + 1)
    expected = referee.swim(fish, drive, time)
    assert np.ptp(expected[:, :3], axis=0).min() > 0.02  # it swims: zeros would agree with anything
    found = ode.simulate(fish, cpg.joint_motion(fish.cpg, drive, duration, 0.001)).at(time)
    return float(np.max(np.abs(found[:, : expected.shape[1]] - expected)))


@pytest.mark.parametrize(
    ("drive", "coefficients", "munk"),
    [("v1", "published", 0.0), ("v5-v1", "alternative", 0.0), ("v3-t2", "unit", 1.0), ("three", "unit", 0.4)],
)
def test_agrees_with_total_momentum(pike: Fish, drive: str, coefficients: str, munk: float) -> None:
    """Catches slips of U x p, Munk's moment, the inertia matrix, xi, drag, and the jump of velocity with the rates."""
    assert _worst(_fish(pike, coefficients, munk_moment=munk), JUMPS[drive], 0.7) < 1e-5


@pytest.mark.parametrize("munk", [0.0, 1.0])
def test_flexible_tail_agrees_with_four_momenta(pike: Fish, munk: float) -> None:
    """The elastic tail in both formulations, deflection included; its joint jumps too."""
    fish = _fish(pike, "unit", munk_moment=munk, tail_compliance=0.3, tail_damping=0.03)
    assert _worst(fish, JUMPS["v3-t2"], 0.7) < 1e-5


@pytest.mark.slow
def test_agrees_to_eight_digits_with_fine_strips_and_small_steps(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left in the fast tests is quadrature and steps, not a difference of equations."""
    monkeypatch.setattr(referee, "POINTS", 512)
    time = np.linspace(0.0, 1.0, 101)
    expected = referee.swim(pike, JUMPS["v1"], time, rtol=1e-11)
    found = ode.simulate(pike, cpg.joint_motion(pike.cpg, JUMPS["v1"], 1.0, 0.00025)).at(time)
    worst = np.max(np.abs(found[:, :6] - expected), axis=0)
    assert np.all(worst < [1e-8, 1e-8, 5e-8, 1e-8, 1e-8, 1e-8])


@pytest.mark.slow
@pytest.mark.parametrize("munk", [0.0, 1.0])
@pytest.mark.parametrize("coefficients", COEFFICIENT_SETS)
@pytest.mark.parametrize("mode", ["v7", "v1-v5", "v1-t1", "v3-t2"])
def test_agrees_with_total_momentum_over_whole_runs(pike: Fish, mode: str, coefficients: str, munk: float) -> None:
    assert _worst(_fish(pike, coefficients, munk_moment=munk), modes.drive(mode), 6.5) < 1e-5
