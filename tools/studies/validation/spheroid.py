"""Added mass of prolate spheroids: Lamb's closed formulas, and what the strips of `mjfish.StripFluid` have.

[Lamb1932] H. Lamb: Hydrodynamics, 6th ed., art. 114, 115.
[Lamb1918] H. Lamb: The inertia-coefficients of an ellipsoid moving in fluid, A.R.C. R. & M. 623.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from mjfish import StripFluid

#: [Lamb1918]: length over width, and the coefficients axially, laterally and in rotation.
PUBLISHED = (
    (1.00, 0.500, 0.500, 0.000),
    (1.50, 0.305, 0.621, 0.094),
    (2.00, 0.209, 0.702, 0.240),
    (2.51, 0.156, 0.763, 0.367),
    (2.99, 0.122, 0.803, 0.465),
    (3.99, 0.082, 0.860, 0.608),
    (4.99, 0.059, 0.895, 0.701),
    (6.01, 0.045, 0.918, 0.764),
    (6.97, 0.036, 0.933, 0.805),
    (8.01, 0.029, 0.945, 0.840),
    (9.02, 0.024, 0.954, 0.865),
    (9.97, 0.021, 0.960, 0.883),
)
_DENSITY, _WIDTH = 1000.0, 0.1


@dataclass(frozen=True)
class Coefficients:
    """Added mass over the mass of the displaced water, added inertia over its inertia about a cross axis."""

    axial: float
    lateral: float
    rotation: float


def lamb(ratio: float) -> Coefficients:
    """Return the coefficients of a spheroid in potential flow [Lamb1932].

    With e the eccentricity and l = log((1 + e) / (1 - e)):

        alpha = 2 (1 - e^2) / e^3 (l / 2 - e),    beta = 1 / e^2 - (1 - e^2) / (2 e^3) l
        k1 = alpha / (2 - alpha),                 k2 = beta / (2 - beta)
        k' = e^4 (beta - alpha) / ((2 - e^2) (2 e^2 - (2 - e^2) (beta - alpha)))

    Args:
        ratio: length over width, 1 or more.

    Example:
        >>> round(lamb(2.0).lateral, 3)
        0.702
    """
    if ratio == 1.0:
        return Coefficients(0.5, 0.5, 0.0)
    e = np.sqrt(1.0 - ratio**-2.0)
    log = np.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * log - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * log
    gap = beta - alpha
    rotation = e**4 * gap / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * gap))
    return Coefficients(float(alpha / (2.0 - alpha)), float(beta / (2.0 - beta)), float(rotation))


def strips(ratio: float) -> Coefficients:
    """Return the coefficients of the same spheroid as strips with c_m = 1.

    They are measured: a unit force or moment on the resting body, over its acceleration, less its own mass.
    """
    length = ratio * _WIDTH
    mass = _DENSITY * np.pi / 6.0 * length * _WIDTH**2
    inertia = mass * (length**2 + _WIDTH**2) / 20.0
    spec = mujoco.MjSpec()
    spec.option.gravity = (0.0, 0.0, 0.0)
    body = spec.worldbody.add_body(name="spheroid", mass=mass, inertia=(inertia, inertia, inertia), explicitinertial=1)
    body.add_freejoint()
    model = spec.compile()
    # An elliptic piece grows from a nose to its end: the spheroid is two of them, back to back.
    nose = {"from": 0.0, "to": 0.5 * length, "height": [0.0, _WIDTH], "width": [0.0, _WIDTH], "profile": "elliptic"}
    half = {"body": "spheroid", "length": 0.5 * length, "sections": [nose], "c_m": 1.0}
    front = {**half, "origin": (0.5 * length, 0.0, 0.0), "axis": (-1.0, 0.0, 0.0)}
    rear = {**half, "origin": (-0.5 * length, 0.0, 0.0), "axis": (1.0, 0.0, 0.0)}
    fluid = StripFluid(model, [front, rear], density=_DENSITY)

    def added(axis: int, own: float) -> float:
        data = mujoco.MjData(model)
        data.qfrc_applied[axis] = 1.0
        with fluid.installed():
            mujoco.mj_forward(model, data)
        return float((1.0 / data.qacc[axis] - own) / own)

    return Coefficients(added(0, mass), added(1, mass), added(5, inertia))
