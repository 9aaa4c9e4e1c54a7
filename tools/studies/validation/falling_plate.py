"""A plate that falls through water: the model of Andersen, Pesavento and Wang, and the strips of `mjfish.StripFluid`.

[Andersen2005a] A. Andersen, U. Pesavento, Z. J. Wang: Unsteady aerodynamics of fluttering and tumbling plates, J. Fluid
    Mech. 541, 65-90.
[Andersen2005b] the same: Analysis of transitions between fluttering, tumbling and steady descent of falling cards,
    J. Fluid Mech. 541, 91-104.

Units are those of [Andersen2005b]: lengths in half chords a, velocities in U, U^2 = (rho_s / rho - 1) g b with half
the thickness b, times in a / U; I* = rho_s b / (rho a).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from mjfish import StripFluid
from mjfish.numerics.arrays import FloatArray

#: Of [Andersen2005b]: circulation by translation and rotation, drag broadside A + B and edgewise A - B, friction.
C_T, C_R, A, B, MU_1, MU_2 = 1.2, np.pi, 1.4, 1.0, 0.2, 0.2
#: How the plate is let go: velocity normal to it, its angle [rad], and its rate of turning.
START = (0.01, 0.5, 0.0)
#: Time that is simulated; what is told is of its second half.
DURATION = 200.0
_STEP = 0.004
#: Half chord [m], U [m/s], density of the water [kg/m3], span [m].
_HALF_CHORD, _SPEED, _DENSITY, _SPAN = 0.05, 0.1, 1000.0, 1.0


@dataclass(frozen=True)
class Fall:
    """How a plate falls, in the units of the module.

    Attributes:
        turns: whole turns, forth less back.
        swing: range of the angle [deg].
        descent: mean speed downwards.
        drift: mean speed to the side, without sign.
    """

    turns: float
    swing: float
    descent: float
    drift: float

    @property
    def motion(self) -> str:
        """What it does: tumbles where it turns over again and again, flutters where it swings, else descends."""
        if abs(self.turns) > 1.5:
            return "tumbles"
        return "flutters" if self.swing > 1.0 else "descends without turning"


def _fall(path: FloatArray, time: float) -> Fall:
    """Return what x, y, angle (n, 3) over a time say."""
    x, y, angle = (path[-1] - path[0]).tolist()
    return Fall(angle / (2.0 * np.pi), float(np.degrees(np.ptp(path[:, 2]))), -y / time, abs(x) / time)


@dataclass(frozen=True)
class Terms:
    """Coefficients of the published equations that strips have otherwise.

    Attributes:
        rotation: C_R, of the circulation that goes with the rate of turning.
        translation: C_T, of the lift of a slanting plate.
        friction: mu_1, of the moment that goes with the rate of turning.
    """

    rotation: float = C_R
    translation: float = C_T
    friction: float = MU_1


PUBLISHED = Terms()
#: What strips have: no circulation by turning, B for C_T, and the drag of turning by its square alone.
AS_STRIPS = Terms(rotation=0.0, translation=B, friction=0.0)


def published(inertia: float, terms: Terms = PUBLISHED, start: tuple[float, float, float] = START) -> Fall:
    """Return the fall of a thin plate by [Andersen2005b], eqs. (5.1)-(5.3) with (4.7)-(4.9).

    Args:
        inertia: I*.
        terms: coefficients, by default the published ones.
        start: see `START`.
    """

    def rates(_: float, state: FloatArray) -> list[float]:
        u, v, angle, w = state[:4]
        speed = np.hypot(u, v) + 1e-300
        lift = 2.0 / np.pi * (terms.rotation * w - terms.translation * u * v / speed)
        drag = (A - B * (u**2 - v**2) / speed**2) * speed / np.pi
        return [
            ((inertia + 1.0) * w * v - lift * v - np.sin(angle) - drag * u) / inertia,
            (lift * u - inertia * w * u - np.cos(angle) - drag * v) / (inertia + 1.0),
            w,
            -4.0 * (u * v + (terms.friction + MU_2 * abs(w)) * w) / (inertia + 0.5),
            u * np.cos(angle) - v * np.sin(angle),
            u * np.sin(angle) + v * np.cos(angle),
        ]

    time = np.linspace(0.5 * DURATION, DURATION, 4001)
    normal, angle, turning = start
    found = solve_ivp(
        rates, (0.0, DURATION), [0.0, normal, angle, turning, 0.0, 0.0], "DOP853", time, rtol=1e-10, atol=1e-12
    )
    return _fall(found.y[[4, 5, 2]].T, 0.5 * DURATION)


def strips(inertia: float, munk_moment: float, start: tuple[float, float, float] = START) -> Fall:
    """Return the fall of the same plate in MuJoCo, its sections strips of mjfish's water.

    The strips lie along the span, so that a section is the plate's own. c_d = A + B is the drag broadside; the
    thickness is such that edgewise it is A - B, for drag on an edge goes with its thickness. Both drags together lift
    a slanting plate by B sin 2 alpha, where the published model has C_T sin 2 alpha; the drag of turning is 0.19 |w| w
    for MU_2 |w| w; nothing stands for C_R and MU_1. So strips with the whole Munk moment are nearly `AS_STRIPS`.

    Args:
        inertia: I*.
        munk_moment: share of the Munk moment.
        start: see `START`.
    """
    scale = _HALF_CHORD / _SPEED
    mass = np.pi * inertia * _DENSITY * _HALF_CHORD**2 * _SPAN
    gyration = 0.25 * mass * _HALF_CHORD**2
    gravity = _SPEED**2 / (inertia * _HALF_CHORD)  # weight less buoyancy over mass
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option gravity="0 0 {-gravity}" integrator="RK4" timestep="{_STEP * scale}"/>
          <worldbody><body name="plate">
            <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint type="hinge" axis="0 -1 0"/>
            <inertial pos="0 0 0" mass="{mass}" diaginertia="{gyration} {gyration} {gyration}"/>
          </body></worldbody>
        </mujoco>""")
    link = {
        "body": "plate",
        "origin": (0.0, 0.5 * _SPAN, 0.0),
        "axis": (0.0, -1.0, 0.0),
        "up": (1.0, 0.0, 0.0),
        "length": _SPAN,
        "height": 2.0 * _HALF_CHORD,
        "width": 2.0 * _HALF_CHORD * (A - B) / (A + B),
        "c_d": A + B,
        "munk_moment": munk_moment,
        "volume": 0.0,
    }
    fluid = StripFluid(model, [link], density=_DENSITY)
    data = mujoco.MjData(model)
    normal, data.qpos[2], turning = start
    data.qvel[:] = np.array([-normal * np.sin(start[1]), normal * np.cos(start[1]), turning]) * (
        _SPEED,
        _SPEED,
        1.0 / scale,
    )
    steps = round(DURATION / _STEP)
    path = np.empty((steps, 3))
    with fluid.installed():
        for k in range(steps):
            path[k] = data.qpos
            mujoco.mj_step(model, data)
    half = path[steps // 2 :] / (_HALF_CHORD, _HALF_CHORD, 1.0)
    return _fall(half, (len(half) - 1) * _STEP)
