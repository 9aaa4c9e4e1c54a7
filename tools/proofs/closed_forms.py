"""A link that is pushed or turned from rest accelerates as a textbook says; closed forms, no code of the package."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts, trees

#: Ways to push the plate of `trees.plate`.
PUSHES = ("along", "across height", "across width", "roll", "com ahead", "com below")
_LENGTH, _HEIGHT, _WIDTH = 0.3, 0.12, 0.05
_FORCE, _TORQUE = 2.0, 0.03
#: How far the com is off the middle in the last two [m].
_AHEAD, _BELOW = 0.07, 0.021


@dataclass(frozen=True)
class Push:
    """What is applied, where, and what must come of it, in the plate's axes at rest.

    Attributes:
        com: of the plate [m], its frame at the front end.
        force, point: what is applied [N], and where [m].
        torque: and besides [N m].
        linear, angular: the acceleration of the middle [m/s2]; of turning [rad/s2].
    """

    com: FloatArray
    force: FloatArray
    point: FloatArray
    torque: FloatArray
    linear: FloatArray
    angular: FloatArray


def pushes(c_m: float) -> Iterator[tuple[str, Push]]:
    """Yield every way to push the plate, and what a textbook says."""
    plate = trees.plate()
    m, inertia = plate.mass, np.diag(plate.inertia)
    water = c_m * 1000.0 * np.pi / 4.0 * _LENGTH
    m_y, m_z = water * _HEIGHT**2, water * _WIDTH**2
    roll = inertia[0] + water * (_HEIGHT**2 - _WIDTH**2) ** 2 / 32.0
    zero, middle = np.zeros(3), np.array([-_LENGTH / 2.0, 0.0, 0.0])
    e = np.eye(3)
    for name, axis, mass in (("along", 0, m), ("across height", 1, m + m_y), ("across width", 2, m + m_z)):
        yield name, Push(middle, _FORCE * e[axis], middle, zero, _FORCE / mass * e[axis], zero)
    yield "roll", Push(middle, zero, middle, _TORQUE * e[0], zero, _TORQUE / roll * e[0])
    # Two masses on a stick: pushed where they balance, the plate does not turn; a couple turns it about that point.
    both = m * m_y / (m + m_y)
    for name, offset, turn in (("com ahead", _AHEAD * e[0], 2), ("com below", -_BELOW * e[2], 0)):
        com = middle + offset
        balance = middle + m / (m + m_y) * offset
        yield f"{name}, pushed", Push(com, _FORCE * e[1], balance, zero, _FORCE / (m + m_y) * e[1], zero)
        stick = float(offset @ offset)
        about = inertia[2] + m_y * _LENGTH**2 / 12.0 if turn == 2 else roll
        angular = _TORQUE / (about + both * stick) * e[turn]
        yield (
            f"{name}, turned",
            Push(com, zero, middle, _TORQUE * e[turn], np.cross(angular, middle - balance), angular),
        )


def difference(c_m: float, coupling: Coupling, integrator: str) -> dict[str, float]:
    """Return the largest relative difference of the accelerations from the closed form, by way to push.

    The plate lies askew in the world.
    """
    worst: dict[str, float] = {}
    for name, push in pushes(c_m):
        plate = replace(trees.plate(com=tuple(push.com)), strips=({**trees.plate().strips[0], "c_m": c_m},))
        model = parts.spec([plate], integrator=integrator).compile()
        fluid = parts.wet(model, [plate], coupling)
        data = mujoco.MjData(model)
        data.qpos[3:] = np.array([0.8, 0.3, -0.4, 0.2])
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_kinematics(model, data)
        turned = data.xmat[1].reshape(3, 3)
        data.qfrc_applied[:3] = turned @ push.force
        data.qfrc_applied[3:] = np.cross(push.point, push.force) + push.torque
        with fluid.installed():
            mujoco.mj_forward(model, data)
        angular = data.qacc[3:]
        middle = np.array([-_LENGTH / 2.0, 0.0, 0.0])
        linear = turned.T @ data.qacc[:3] + np.cross(angular, middle)
        scale = np.abs([*push.linear, *(_LENGTH * push.angular)]).max()
        worst[name] = float(np.abs([linear - push.linear, _LENGTH * (angular - push.angular)]).max() / scale)
    return worst
