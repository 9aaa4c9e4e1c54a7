"""The angles that servos reach, learned from the data: an odd and rising function of the command."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import curved
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.hydro.spline import spline, spline_slope
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior, smooth_curve

#: Angle between knots [rad], and their number: the last one is at 60 degrees.
_SPACING, _KNOTS = np.pi / 18.0, 7
#: Gauss points in an interval between knots: its integrand is the exponential of a cubic.
_NODES, _WEIGHTS = (tuple(map(float, part)) for part in np.polynomial.legendre.leggauss(6))
#: Bounds of the logarithm of the slope: a stop leaves a hundredth of it.
_LOW, _HIGH = -0.5, 5.0


@compiled
def _integral(a: float, b: float, knots: FloatArray) -> float:
    """Return INT_a^b exp(-g) dx within one interval between knots, in units of the spacing."""
    total = 0.0
    for k in range(len(_NODES)):
        total += _WEIGHTS[k] * np.exp(-spline(0.5 * (a + b) + 0.5 * (b - a) * _NODES[k], knots, 0, _KNOTS))
    return 0.5 * (b - a) * total


@compiled
def _bent(command: FloatArray, knots: FloatArray, out: FloatArray) -> None:
    """Write angle, slope and curvature (3, m) by the command at commands (m,) [rad]."""
    reached = np.zeros(_KNOTS)
    for k in range(1, _KNOTS):
        reached[k] = reached[k - 1] + _integral(k - 1.0, float(k), knots)
    for i in range(len(command)):
        x = abs(command[i]) / _SPACING
        k = min(int(x), _KNOTS - 1)
        slope = np.exp(-spline(x, knots, 0, _KNOTS))
        angle = _SPACING * (reached[k] + (_integral(float(k), x, knots) if k < _KNOTS - 1 else (x - k) * slope))
        out[0, i] = angle if command[i] >= 0.0 else -angle
        out[1, i] = slope
        bend = -slope * spline_slope(x, knots, 0, _KNOTS) / _SPACING
        out[2, i] = bend if command[i] >= 0.0 else -bend


def _name(knot: int) -> str:
    return f"knot_{knot}"


class ServoCurve(Effect):
    """The joints end at an odd and rising function of their command c: theta = INT_0^c exp(-g(|x|)) dx, learned.

    g is a cubic B-spline with knots ten degrees apart up to 60, level at zero and beyond; the same for all joints. The
    slope exp(-g) is positive whatever g is, so that no joint turns back:

        theta' = exp(-g) c',   theta'' = exp(-g) (c'' - g'(|c|) sgn(c) c'^2)
    """

    name, domain, mechanism = "servo_curve", "drive", "servo_limit"
    learned = True
    summary = "the joints reach other angles than they are told, learned"
    parameters = tuple(
        Parameter(
            f"servo_curve.{_name(k)}", "-", 0.0, _LOW, _HIGH, 0.0, 0.05, about=f"g, -ln of the slope near {10 * k} deg"
        )
        for k in range(_KNOTS)
    )
    jerks = False
    source = "Khalil, Nonlinear Systems (2002), sec. 1.2.7: saturation; Ramsay, J. R. Stat. Soc. B 60 (1998): monotony"
    signature = "the swing is wrong by an amount that goes with the angle, the same at every beat frequency"
    confirm = "step the joints on the bench to larger and larger angles and read them"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("stuck-clipped",)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Bend the angles; rates and accelerations by the chain rule."""
        bent = np.empty((3, motion.angle.size))
        _bent(motion.angle.ravel(), np.array([values[p.short] for p in self.parameters]), bent)
        angle, slope, curvature = bent.reshape(3, *motion.angle.shape)
        return curved(motion, angle, slope, curvature)

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the curve at the numbers of a formula."""
        if formula != "servo_saturation":
            return {}
        p, angles = 1.0 / values["softness"], _SPACING * np.arange(_KNOTS)
        logs = (1.0 + 1.0 / p) * np.log1p((values["psi"] * angles**2) ** (0.5 * p))
        return {_name(k): float(np.clip(log, _LOW, _HIGH)) for k, log in enumerate(logs)}

    def priors(self) -> tuple[Prior, ...]:
        """Keep the curve smooth; a stop is steep."""
        return smooth_curve("servo_curve.curve", [p.name for p in self.parameters], 0.3, 1.5)
