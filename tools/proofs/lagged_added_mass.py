"""Added mass from light to heavy, solved with the motion; beside it, one that lags a step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjfish.mujoco.block import block_of
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts, reference, trees
from proofs.dense_equation import dried, equation

#: Added mass across the height over the mass of the plate.
RATIOS = (0.1, 0.3, 0.9, 1.0, 1.1, 3.0, 10.0, 30.0, 100.0)
_STEP = 1e-3
_STEPS = 400
_LENGTH, _HEIGHT = 0.3, 0.12
_MASS = 1000.0 * np.pi / 4.0 * _HEIGHT**2 * _LENGTH  # of the water that moves with it at c_m = 1
#: A run has diverged once an acceleration is wrong by so many times the one at the start.
_DIVERGED = 1e3


@dataclass(frozen=True)
class Run:
    """A run of the plate.

    Attributes:
        error: largest difference of the acceleration from the dense solution at the same state, in the second half of
            the run (all of it where it diverged), as a part of the exact acceleration at the start.
        diverged: at which step; -1: it did not.
    """

    error: float
    diverged: int


def plate(ratio: float) -> parts.Part:
    """Return a slender plate of even mass whose added mass across its height is `ratio` times that mass."""
    along = _MASS * _HEIGHT**2 / 16.0
    across = _MASS * _LENGTH**2 / 12.0
    inertia = tuple(map(tuple, np.diag([along, across, across])))
    strips = {"length": _LENGTH, "height": _HEIGHT, "width": 0.02, "c_m": ratio, "c_d": 1.5, "c_f": 0.01}
    middle = (-_LENGTH / 2.0, 0.0, 0.0)
    return replace(trees.plate(mass=_MASS, com=middle), inertia=inertia, strips=(strips,))


def run(ratio: float, coupling: Coupling | None, integrator: str = "Euler", steps: int = _STEPS) -> Run:
    """Push and turn the plate to and fro while it glides; coupling None: the lagged scheme."""
    one = plate(ratio)
    model = parts.spec([one], integrator=integrator, step=_STEP).compile()
    fluid = parts.wet(model, [one], coupling or "inertia")
    lagged = _Lagged(model)
    data = mujoco.MjData(model)
    data.qvel[:] = (-0.8, 0.1, 0.05, 0.3, 0.2, -0.4)
    errors: list[float] = []
    scale, diverged = 0.0, -1
    for step in range(steps):
        phase = 2.0 * np.pi * 2.0 * data.time
        data.qfrc_applied[:] = (0.0, 4.0 * np.cos(phase), 1.0, 0.01, 0.02, 0.3 * np.sin(phase))
        exact = equation(model, data).acceleration()
        scale = scale or float(np.abs(exact).max())
        before = data.qvel.copy()
        if coupling is None:
            lagged.step(data)
        else:
            with fluid.installed():
                mujoco.mj_step(model, data)
        errors.append(float(np.abs((data.qvel - before) / _STEP - exact).max()) / scale)
        if not errors[-1] < _DIVERGED:
            diverged = step
            break
    counted = errors if diverged >= 0 else errors[steps // 2 :]
    return Run(max(counted), diverged)


class _Lagged:
    """The scheme at hand for whoever has forces only: the inertial force of the water from the last acceleration."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._dry = dried(model)
        self._water = block_of(model).links
        self._last = np.zeros(model.nv)

    def step(self, data: mujoco.MjData) -> None:
        mujoco.mj_fwdPosition(self._dry, data)
        mujoco.mj_fwdVelocity(self._dry, data)
        for link in self._water:
            J, b = (of(self._dry, data, link) for of in (reference.jacobian_of, reference.bias_of))
            force = reference.force_of(self._dry, data, link) - reference.inertia_of(link) @ (J @ self._last + b)
            data.xfrc_applied[int(link["body"])] = _at_com(data, link, force)
        mujoco.mj_step(self._dry, data)
        self._last = data.qacc.copy()


def _at_com(data: mujoco.MjData, link: np.void, wrench: FloatArray) -> FloatArray:
    axes = reference.axes_of(data, link)
    force = axes @ wrench[:3]
    arm = reference.origin_of(data, link) - data.xipos[int(link["body"])]
    return np.concatenate([force, axes @ wrench[3:] + np.cross(arm, force)])
