"""Drag in proportion to the speed, strip by strip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from link_forces import pushed

from mjfish.drive.motion import JointMotion
from mjfish.effects.linear_drag import LinearDrag
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.force import drag
from mjfish.hydro.link import link_records
from mjfish.numerics.arrays import FloatArray
from mjfish.ode import simulate


def _records(fish: Fish, u: float, v: float, w: float) -> Any:
    records = link_records(fish)
    records["u"], records["v"], records["w"] = u, v, w
    return records


def _force(records: Any, link: int, along: float, across: float) -> FloatArray:
    assert LinearDrag.load is not None
    return pushed(LinearDrag.load, [along, across], records, link)


@pytest.mark.parametrize("link", range(5))
def test_every_strip_is_held_back_by_its_own_speed(pike: Fish, link: int) -> None:
    """Drag -psi_f INT p dr u along, -psi_d INT h q dr across, and its moment. Catches a moment of height mistaken."""
    u, v, w, along, across = -0.4, 0.13, -2.0, 1.5, 150.0
    outline = outlines(pike)[link]
    share = -across * outline.strip_weight * outline.strip_height * (v + w * outline.strip_r)
    expected = [-along * outline.wetted * u, share.sum(), share @ outline.strip_r]
    found = _force(_records(pike, u, v, w), link, along, across)
    np.testing.assert_allclose(found, expected, rtol=2e-4)


def test_units_are_what_the_docstring_says(pike: Fish) -> None:
    """psi_f = 1.5 N s/m3 is c_f = 0.01 at 0.3 m/s, psi_d = 150 N s/m3 is c_d = 1."""
    records = _records(pike, -0.3, 0.3, 0.0)
    records["c_f"], records["c_d"] = 0.01, 1.0
    for link in range(5):
        np.testing.assert_allclose(_force(records, link, 1.5, 150.0), drag(records[link]), rtol=1e-3)


def test_twice_the_speed_is_twice_the_force_and_it_takes_power(pike: Fish) -> None:
    rng = np.random.default_rng(7)
    for u, v, w in rng.standard_normal((20, 3)) * [0.5, 0.5, 5.0]:
        for link in range(5):
            slow, fast = (_force(_records(pike, s * u, s * v, s * w), link, 1.0, 100.0) for s in (1.0, 2.0))
            np.testing.assert_allclose(fast, 2.0 * slow, rtol=1e-12)
            assert slow @ [u, v, w] < 0.0


def test_a_coasting_fish_slows_down_exponentially(pike: Fish) -> None:
    """With m u' = -psi_f W u, no other drag, joints straight: u = u_0 exp(-psi_f W t / m)."""
    assert LinearDrag.load is not None
    grid = np.linspace(0.0, 2.0, 401)
    still = np.zeros((400, 3, 4))
    motion = JointMotion(time=grid, angle=still, rate=still, acceleration=still)
    bare = {f"{kind}.{group}": 0.0 for kind in ("c_m", "c_d", "c_f") for group in ("head", "body", "tail")}
    run = simulate(pike, motion, values=bare, velocity=np.array([0.5, 0.0, 0.0]), loads=[(LinearDrag.load, [4.0, 0.0])])
    mass, wetted = sum(link.mass for link in pike.links), sum(o.wetted for o in outlines(pike))
    time = np.linspace(0.1, 1.9, 7)
    np.testing.assert_allclose(run.at(time)[:, 0], 0.5 * np.exp(-4.0 * wetted / mass * time), rtol=1e-6)
