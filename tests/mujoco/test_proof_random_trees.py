"""Any tree of bodies in water, any joints, any strips: MuJoCo's acceleration against a dense solution from slices."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts, reference
from proofs.dense_equation import dried, state_of
from proofs.derivation import motion_of
from proofs.parts import Part
from proofs.slices import Strips, inertial_wrench, strips

COUPLINGS: tuple[Coupling, ...] = ("inertia", "xfrc")


@st.composite
def planar_trees(draw: st.DrawFn) -> tuple[Part, ...]:
    """Return one to six bodies in a plane, each on the world or an earlier one by a hinge or a slide."""
    return draw(_trees(("hinge", "slide"), ("hinge", "slide", "none"), planar=True))


@st.composite
def spatial_trees(draw: st.DrawFn) -> tuple[Part, ...]:
    """Return one to six bodies in space, with joints of every kind."""
    return draw(_trees(("free", "ball", "hinge", "slide"), ("ball", "hinge", "slide", "none"), planar=False))


@st.composite
def _trees(draw: st.DrawFn, of_root: tuple[str, ...], of_child: tuple[str, ...], *, planar: bool) -> tuple[Part, ...]:
    found: list[Part] = []
    for k in range(draw(st.integers(1, 6))):
        parent = draw(st.sampled_from(["", *(part.name for part in found)])) if k else ""
        joint: Any = draw(st.sampled_from(of_child if parent else of_root))
        numbers = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        count = draw(st.integers(0, 2)) if k else 1  # some bodies are dry, some carry two links, the first is wet
        axis = np.array([0.0, 0.0, 1.0] if joint == "hinge" else [1.0, 0.0, 0.0])
        if planar:
            turned = Rotation.from_euler("z", numbers.uniform(-np.pi, np.pi))
            axis = turned.apply(axis) if joint == "slide" else axis
        else:
            turned, axis = Rotation.random(rng=numbers), Rotation.random(rng=numbers).apply(axis)
        flat = np.array([1.0, 1.0, 0.0 if planar else 1.0])
        spin = np.eye(3) if planar else Rotation.random(rng=numbers).as_matrix()
        inertia = spin @ np.diag(numbers.uniform(1.0, 1.9, 3) * 1e-3) @ spin.T
        found.append(
            Part(
                name=f"body_{k}",
                parent=parent,
                pos=tuple(flat * numbers.uniform(-0.3, 0.3, 3)),
                quat=tuple(turned.as_quat(scalar_first=True)),
                joint=joint,
                axis=tuple(axis),
                mass=float(numbers.uniform(0.2, 3.0)),
                com=tuple(flat * numbers.uniform(-0.1, 0.1, 3)),
                inertia=tuple(map(tuple, inertia)),
                strips=tuple(_strip(numbers, flat, planar=planar) for _ in range(count)),
            )
        )
    return tuple(found)


def _strip(numbers: np.random.Generator, flat: FloatArray, *, planar: bool) -> dict[str, Any]:
    length = float(numbers.uniform(0.05, 0.4))
    return {
        "length": length,
        "station": [0.0, float(numbers.uniform(0.2, 0.8)) * length, length],
        "height": numbers.uniform(0.01, 0.15, 3).tolist(),
        "width": numbers.uniform(0.005, 0.08, 3).tolist(),
        "origin": (flat * numbers.uniform(-0.1, 0.1, 3)).tolist(),
        "axis": (flat * numbers.normal(size=3)).tolist(),
        "up": [0.0, 0.0, 1.0] if planar else numbers.normal(size=3).tolist(),
        "c_m": float(numbers.uniform(0.2, 3.0)),
        "c_d": float(numbers.uniform(0.0, 2.0)),
        "c_f": float(numbers.uniform(0.0, 0.1)),
        "munk_moment": float(numbers.uniform(0.0, 1.0)),
        "roll_damping": float(numbers.uniform(0.0, 2.0)),
    }


def _state(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    numbers, data = np.random.default_rng(seed), mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, numbers.normal(size=model.nv), 1.0)
    data.qvel[:] = numbers.normal(size=model.nv)
    data.qfrc_applied[:] = numbers.normal(size=model.nv)
    return data


def _of_slices(
    dry: mujoco.MjModel, start: mujoco.MjData, acceleration: FloatArray, links: list[tuple[str, Strips]]
) -> FloatArray:
    """Return the generalised force (nv,) of the inertia of the water, its momentum differentiated along the motion."""
    moved, total = mujoco.MjData(dry), np.zeros(dry.nv)
    for body, one in links:

        def motion(t: float, body: str = body, one: Strips = one) -> Any:
            moved.time = t
            moved.qpos[:] = start.qpos
            mujoco.mj_integratePos(dry, moved.qpos, start.qvel + 0.5 * t * acceleration, t)
            moved.qvel[:] = start.qvel + t * acceleration
            mujoco.mj_fwdPosition(dry, moved)
            mujoco.mj_fwdVelocity(dry, moved)
            return motion_of(dry, moved, body, one)

        wrench = inertial_wrench(one, motion, one.kappa)
        linear, angular = np.zeros((3, dry.nv)), np.zeros((3, dry.nv))
        mujoco.mj_jac(dry, start, linear, angular, motion(0.0).point, dry.body(body).id)
        total += linear.T @ wrench[:3] + angular.T @ wrench[3:]
    return total


def _dense_from_slices(model: mujoco.MjModel, data: mujoco.MjData, tree: tuple[Part, ...]) -> FloatArray:
    """Return q'' (nv,) of (M + M_a) q'' = tau - c + f(0): the force of the slices is f(0) - M_a q''."""
    dry = dried(model)
    alone = state_of(dry, data)
    links = [(part.name, strips(link)) for part in tree for link in part.strips]
    at_rest = _of_slices(dry, alone, np.zeros(dry.nv), links)
    added = np.column_stack([at_rest - _of_slices(dry, alone, unit, links) for unit in np.eye(dry.nv)])
    rigid = np.zeros((dry.nv, dry.nv))
    mujoco.mj_fullM(dry, alone, rigid)
    np.testing.assert_allclose(added, added.T, rtol=0, atol=1e-6 * np.abs(added).max())
    return np.asarray(np.linalg.solve(rigid + added, alone.qfrc_applied - alone.qfrc_bias + at_rest))


def _accelerations(model: mujoco.MjModel, tree: tuple[Part, ...], seed: int) -> tuple[list[FloatArray], mujoco.MjData]:
    found = []
    for coupling in COUPLINGS:
        fluid = parts.wet(model, tree, coupling)
        data = _state(fluid.model, seed)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
        found.append(data.qacc.copy())
    return found, data


@pytest.mark.parametrize("trees", [planar_trees(), spatial_trees()], ids=["planar", "spatial"])
def test_inertia_of_the_water_on_any_tree_is_that_of_its_slices(trees: st.SearchStrategy[tuple[Part, ...]]) -> None:
    """Without drag, whose strips are no exact quadrature; slices share no formula with the fluid."""

    @settings(max_examples=15, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(trees, st.integers(0, 2**32 - 1))
    def holds(tree: tuple[Part, ...], seed: int) -> None:
        tree = parts.with_water(tree, c_d=0.0, c_f=0.0, roll_damping=0.0)
        model = parts.spec(tree).compile()
        model.opt.wind[:] = (0.4, -0.3, 0.2)
        found, data = _accelerations(model, tree, seed)
        expected = _dense_from_slices(model, data, tree)
        for acceleration in found:
            np.testing.assert_allclose(acceleration, expected, rtol=0, atol=1e-6 * np.abs(expected).max())

    holds()


@pytest.mark.parametrize("trees", [planar_trees(), spatial_trees()], ids=["planar", "spatial"])
def test_water_on_any_tree_is_solved_as_a_dense_equation_is(trees: st.SearchStrategy[tuple[Part, ...]]) -> None:
    """With all of its forces, and both couplings, to rounding."""

    @settings(max_examples=50, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(trees, st.integers(0, 2**32 - 1))
    def holds(tree: tuple[Part, ...], seed: int) -> None:
        model = parts.spec(tree).compile()
        model.opt.wind[:] = (0.4, -0.3, 0.2)
        found, _ = _accelerations(model, tree, seed)
        fluid = parts.wet(model, tree, "xfrc")
        same = _state(fluid.model, seed)
        mujoco.mj_forward(dried(fluid.model), same)
        expected = reference.solve(fluid.model, same)
        for acceleration in found:
            np.testing.assert_allclose(acceleration, expected, rtol=0, atol=1e-9 * np.abs(expected).max())

    holds()
