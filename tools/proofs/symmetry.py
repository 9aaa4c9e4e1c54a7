"""Symmetries: what must not make a difference, and what must turn with the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts, trees
from proofs.parts import Part

GRAVITY, WIND = np.array([0.0, 0.0, -9.81]), np.array([0.4, -0.3, 0.2])
_MIRROR = np.array([1.0, -1.0, 1.0])
_STEPS = 300


def _model(tree: Sequence[Part], integrator: str, gravity: FloatArray, wind: FloatArray) -> mujoco.MjModel:
    model = parts.spec(tree, integrator=integrator, step=5e-4).compile()
    model.opt.gravity[:], model.opt.wind[:] = gravity, wind
    return model


def _run(
    tree: Sequence[Part], coupling: Coupling, integrator: str, state: tuple[FloatArray, FloatArray],
    gravity: FloatArray = GRAVITY, wind: FloatArray = WIND,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return qpos and qvel (steps + 1, .) of a run from a state."""
    model = _model(tree, integrator, gravity, wind)
    fluid = parts.wet(model, tree, coupling)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state
    poses, speeds = [data.qpos.copy()], [data.qvel.copy()]
    with fluid.installed():
        for _ in range(_STEPS):
            mujoco.mj_step(model, data)
            poses.append(data.qpos.copy())
            speeds.append(data.qvel.copy())
    return np.array(poses), np.array(speeds)


def _start(tree: Sequence[Part]) -> tuple[FloatArray, FloatArray]:
    model = parts.spec(tree).compile()
    data = mujoco.MjData(model)
    parts.stir(model, data, seed=2, speed=0.7)
    return data.qpos.copy(), data.qvel.copy()


def mirror(coupling: Coupling, integrator: str) -> float:
    """Return how far the mirrored chain is from the mirror image of the chain, in the velocities of a run."""
    chain = trees.chain()
    pose, speed = _start(chain)
    image = tuple(part.mirrored() for part in chain)
    flip = np.array([*_MIRROR, *-_MIRROR, *-_MIRROR, *-np.ones(len(speed) - 9)])  # free, ball, hinges
    flip_pose = np.array([*_MIRROR, 1, *-_MIRROR, 1, *-_MIRROR, *-np.ones(len(pose) - 11)])
    _, ours = _run(chain, coupling, integrator, (pose, speed))
    _, theirs = _run(image, coupling, integrator, (flip_pose * pose, flip * speed), _MIRROR * GRAVITY, _MIRROR * WIND)
    return parts.relative(flip * theirs, ours)


def turned_world(coupling: Coupling, integrator: str) -> float:
    """Return the same for a world that is turned, gravity and current with it."""
    chain = trees.chain()
    pose, speed = _start(chain)
    turn = Rotation.from_rotvec([0.7, -1.1, 0.4])
    matrix = turn.as_matrix()
    turned_pose, turned_speed = pose.copy(), speed.copy()
    turned_pose[:3] = matrix @ pose[:3]
    root = turn * Rotation.from_quat(pose[3:7], scalar_first=True)
    turned_pose[3:7] = root.as_quat(scalar_first=True)
    turned_speed[:3] = matrix @ speed[:3]
    _, ours = _run(chain, coupling, integrator, (pose, speed))
    _, theirs = _run(chain, coupling, integrator, (turned_pose, turned_speed), matrix @ GRAVITY, matrix @ WIND)
    theirs[:, :3] = theirs[:, :3] @ matrix
    return parts.relative(theirs, ours)


def drifting(coupling: Coupling, integrator: str) -> float:
    """Return how far a chain that drifts with a current is from the same chain in still water, positions too."""
    chain = trees.chain()
    pose, speed = _start(chain)
    drifted = speed.copy()
    drifted[:3] += WIND
    still_pose, still = _run(chain, coupling, integrator, (pose, speed), wind=np.zeros(3))
    moving_pose, moving = _run(chain, coupling, integrator, (pose, drifted))
    moving[:, :3] -= WIND
    moving_pose[:, :3] -= np.arange(len(moving))[:, None] * 5e-4 * WIND
    return max(parts.relative(moving, still), parts.relative(moving_pose, still_pose))


def _acceleration_difference(one: Part, other: Part, coupling: Coupling, states: int = 20) -> float:
    """Return the largest relative difference of two tellings of one body."""
    worst = 0.0
    models = [_model([part], "RK4", GRAVITY, WIND) for part in (one, other)]
    fluids = [parts.wet(model, [part], coupling) for model, part in zip(models, (one, other), strict=True)]
    data = [mujoco.MjData(model) for model in models]
    for _ in parts.states(models[0], data[0], states, speed=2.0):
        data[1].qpos[:], data[1].qvel[:] = data[0].qpos, data[0].qvel
        with fluids[0].installed():
            for model, each in zip(models, data, strict=True):
                mujoco.mj_forward(model, each)
        worst = max(worst, parts.relative(data[1].qacc, data[0].qacc))
    return worst


def _told(change: dict[str, Any], drag: bool) -> Part:
    (strips,) = trees.CROOKED.strips
    plain = {} if drag else {"c_d": 0.0}
    return replace(trees.CROOKED, strips=({**strips, **plain, **change},))


def from_the_other_end(coupling: Coupling, *, drag: bool) -> float:
    """Return the difference that it makes to tell the stations from the other end."""
    (strips,) = trees.CROOKED.strips
    axis = np.array(strips["axis"])
    end = np.array(strips["origin"]) + strips["length"] * axis / np.linalg.norm(axis)
    change = {
        "station": tuple(strips["length"] - r for r in reversed(strips["station"])),
        "height": tuple(reversed(strips["height"])),
        "width": tuple(reversed(strips["width"])),
        "origin": tuple(end),
        "axis": tuple(-axis),
    }
    return _acceleration_difference(_told({}, drag), _told(change, drag), coupling)


def width_for_height(coupling: Coupling, *, drag: bool) -> float:
    """Return the difference that it makes to call the height the width, a quarter of a turn on."""
    (strips,) = trees.CROOKED.strips
    across = np.cross(strips["axis"], strips["up"])
    change = {"height": strips["width"], "width": strips["height"], "up": tuple(across)}
    return _acceleration_difference(_told({}, drag), _told(change, drag), coupling)


def round_section(coupling: Coupling, *, drag: bool) -> float:
    """Return the difference that turning `up` about the axis makes to a body of circular sections."""
    (strips,) = trees.CROOKED.strips
    circular = {"height": strips["height"], "width": strips["height"]}
    across = np.cross(strips["axis"], strips["up"])
    turned = {**circular, "up": tuple(0.8 * np.array(strips["up"]) + 0.7 * across)}
    return _acceleration_difference(_told(circular, drag), _told(turned, drag), coupling)


def in_two_pieces(coupling: Coupling, *, drag: bool) -> float:
    """Return the difference that it makes to tell one body's strips as two links, the rear one first."""
    (strips,) = trees.CROOKED.strips
    axis = np.array(strips["axis"])
    cut = strips["station"][1]
    front = {"length": cut, **{key: strips[key][:2] for key in ("station", "height", "width")}}
    rear = {
        "length": strips["length"] - cut,
        "station": (0.0, strips["length"] - cut),
        **{key: strips[key][1:] for key in ("height", "width")},
        "origin": tuple(np.array(strips["origin"]) + cut * axis / np.linalg.norm(axis)),
    }
    pieces = tuple(_told(piece, drag).strips[0] for piece in (rear, front))
    return _acceleration_difference(_told({}, drag), replace(trees.CROOKED, strips=pieces), coupling)
