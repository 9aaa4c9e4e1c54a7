"""The drag law learned from the data: coefficients as smooth functions of the speed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from mjfish.data import Trial
from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint, Values, variant
from mjfish.effects.exponential_drag import VISCOSITY
from mjfish.effects.reynolds_drag import REFERENCE_SPEED
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.load import PARAMETERS, load
from mjfish.hydro.spline import spline, spline_slope, spline_weights
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior, about, smooth_curve

#: Octaves below the reference speed at which the knots begin, and their number: of c_d, of c_f.
_BELOW_D, _KNOTS_D = 3, 7
_BELOW_F, _KNOTS_F = 3, 6
#: The reference speed, in lengths of the fish a second.
_LENGTHS = 2.0
_WHOLE_D, _WHOLE_F, _HEIGHT, _ACROSS, _ALONG = 0, 1, 2, 3, 3 + _KNOTS_D
_SPEED, _TALL = _ALONG + _KNOTS_F, _ALONG + _KNOTS_F + 1


_LN2 = float(np.log(2.0))
#: Added to the square of a speed [m2/s2]: at rest it has no logarithm.
_TINY = 1e-18


@merged
def _octave(here: float, other: float, whole: float, speed: float) -> float:
    """Return log2 of sqrt(here^2 + whole other^2) over the reference speed."""
    return float(0.5 * np.log2((here * here + whole * other * other + _TINY) / (speed * speed)))


@merged
def _octave_slope(here: float, other: float, whole: float) -> float:
    """Return the derivative of `_octave` by half of here^2; by other it is `whole` times other times it."""
    return float(1.0 / (_LN2 * (here * here + whole * other * other + _TINY)))


@merged
def _add_weights(out: Any, row: int, first: int, t: float, count: int, force: float) -> None:
    """Add the derivatives of a force by the coefficients of the curve that is its logarithm."""
    k, a, b, c, d = spline_weights(t, count)
    for j in range(4):
        at = k - 1 + j
        if at >= 0 and at < count:
            out[row, first + at] += force * (a if j == 0 else (b if j == 1 else (c if j == 2 else d)))


def _slopes(link: Any, parameters: Any, out: Any) -> None:
    """Write the derivatives of the excess by all parameters and by u, v, w."""
    whole, power, speed, height = parameters[_WHOLE_D], parameters[_HEIGHT], parameters[_SPEED], parameters[_TALL]
    other = parameters[_WHOLE_F]
    by_u, by_v, by_w = PARAMETERS, PARAMETERS + 1, PARAMETERS + 2
    half = -0.5 * link.density
    half_length = 0.5 * link.length
    u, middle = link.u, link.v + half_length * link.w
    t = _octave(u, middle, other, speed) + _BELOW_F
    g = spline(t, parameters, _ALONG, _KNOTS_F)
    whole_force = half * link.c_f * link.wetted * abs(u) * u
    friction = whole_force * np.exp(g)
    _add_weights(out, 0, _ALONG, t, _KNOTS_F, friction)
    turn = friction * spline_slope(t, parameters, _ALONG, _KNOTS_F) * _octave_slope(u, middle, other)
    out[0, _WHOLE_F] = 0.5 * turn * middle * middle
    out[0, by_u] = 2.0 * half * link.c_f * link.wetted * abs(u) * (np.exp(g) - 1.0) + turn * u
    out[0, by_v] = turn * other * middle
    out[0, by_w] = half_length * out[0, by_v]
    for s in range(link.coarse_r.shape[0]):
        r = link.coarse_r[s]
        q = link.v + link.w * r
        taller = np.log2(link.coarse_height[s] / height + 1e-9)
        t = _octave(q, u, whole, speed) + power * taller + _BELOW_D
        g = spline(t, parameters, _ACROSS, _KNOTS_D)
        area = half * link.c_d * link.coarse_weight[s] * link.coarse_height[s]
        force = area * abs(q) * q * np.exp(g)
        _add_weights(out, 1, _ACROSS, t, _KNOTS_D, force)
        _add_weights(out, 2, _ACROSS, t, _KNOTS_D, force * r)
        rise = force * spline_slope(t, parameters, _ACROSS, _KNOTS_D)
        turn = rise * _octave_slope(q, u, whole)
        along, across = turn * whole * u, 2.0 * area * abs(q) * (np.exp(g) - 1.0) + turn * q
        out[1, _WHOLE_D] += 0.5 * turn * u * u
        out[2, _WHOLE_D] += 0.5 * turn * u * u * r
        out[1, _HEIGHT] += rise * taller
        out[2, _HEIGHT] += rise * taller * r
        out[1, by_u] += along
        out[2, by_u] += along * r
        out[1, by_v] += across
        out[2, by_v] += across * r
        out[1, by_w] += across * r
        out[2, by_w] += across * r * r


@load(gradient=_slopes)
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the constant coefficients, strip by strip."""
    whole, power, speed, height = parameters[_WHOLE_D], parameters[_HEIGHT], parameters[_SPEED], parameters[_TALL]
    other = parameters[_WHOLE_F]
    u, middle = link.u, link.v + 0.5 * link.length * link.w
    g = spline(_octave(u, middle, other, speed) + _BELOW_F, parameters, _ALONG, _KNOTS_F)
    along = (np.exp(g) - 1.0) * link.c_f * link.wetted * abs(u) * u
    across = 0.0
    moment = 0.0
    for s in range(link.coarse_r.shape[0]):
        q = link.v + link.w * link.coarse_r[s]
        t = _octave(q, u, whole, speed) + power * np.log2(link.coarse_height[s] / height + 1e-9) + _BELOW_D
        g = spline(t, parameters, _ACROSS, _KNOTS_D)
        share = link.coarse_weight[s] * link.coarse_height[s] * abs(q) * q * (np.exp(g) - 1.0)
        across += share
        moment += share * link.coarse_r[s]
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


#: Factor on a coefficient by speed [m/s], height [m], size of the effect and its values, of formulas.
_FORMULAS: dict[str, Callable[[FloatArray, float, float, Values], FloatArray]] = {
    "reynolds_drag": lambda v, _h, a, _: 1.0 + a * np.sqrt(REFERENCE_SPEED / v),
    "power_drag": lambda v, _h, n, _: (v / REFERENCE_SPEED) ** n,
    "exponential_drag": lambda v, h, a, own: 1.0 + a * np.exp(-v * h / (1e3 * own["reynolds"] * VISCOSITY)),
}


def _names(short: str, count: int) -> list[str]:
    return [f"drag_law.{short}_{k}" for k in range(count)]


def _values(short: str, count: int, below: int, what: str) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(name, "-", 0.0, -3.0, 3.0, 0.0, 0.2, about=f"ln {what} near 2^{k - below} times the reference speed")
        for k, name in enumerate(_names(short, count))
    )


class DragLaw(Effect):
    """Drag coefficients are smooth functions of the speed: c = c_0 exp(g(log2(V / U_0))), U_0 = 2 L / s.

    g is a cubic B-spline with knots an octave apart, one curve for c_d and one for c_f, constant beyond the
    outermost knots; c_0 is the coefficient of the link's group. The level of g is one with that of c_0: the priors let
    it go where c_0 is on a bound. The speed is

        V = sqrt(q^2 + b u^2) (h / h_0)^p  of c_d,      V = sqrt(u^2 + b q^2)  of c_f,

    each with its own b: b = 0 the local speed across or along, b = 1 the whole one, and with b = p = 1 V goes with the
    Reynolds number of the section. Drag takes power whatever g is, as c stays positive.
    """

    name, domain, mechanism = "drag_law", "water", "drag_law"
    learned = True
    summary = "drag coefficients are another function of the speed, learned"
    parameters = (
        Parameter("drag_law.whole_across", "-", 0.2, 0.0, 1.0, 0.2, 0.2, about="b of c_d", shape=True),
        Parameter("drag_law.whole_along", "-", 0.2, 0.0, 1.0, 0.2, 0.2, about="b of c_f", shape=True),
        Parameter("drag_law.height", "-", 0.2, 0.0, 1.0, 0.2, 0.2, about="p, power of the local height", shape=True),
        *_values("across", _KNOTS_D, _BELOW_D, "c_d"),
        *_values("along", _KNOTS_F, _BELOW_F, "c_f"),
    )
    source = "Eilers and Marx, Statistical Science 11 (1996): penalised splines"
    signature = "forward speed against beat frequency is bent; start-ups differ from steady swimming"
    confirm = "swim at more and lower beat frequencies, or tow the stretched fish at several speeds"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-short", "design-one-frequency")
    load = _excess
    reference: ClassVar[tuple[float, float]] = (0.3, 0.1)  # speed [m/s] and height [m]

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with the reference speed and height of the fish."""
        length = sum(link.length for link in fish.links)
        heights = np.concatenate([outline.strip_height for outline in outlines(fish)])
        return variant(DragLaw, reference=(round(_LENGTHS * length, 6), round(float(heights.max()), 6)))

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the reference speed and height."""
        del trial
        return self.reference

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the curve at the numbers of a formula."""
        curves = (("across", _KNOTS_D, _BELOW_D, "pressure"), ("along", _KNOTS_F, _BELOW_F, "friction"))
        if formula not in _FORMULAS:
            return {}
        found = dict.fromkeys(("whole_across", "whole_along", "height"), float(formula == "exponential_drag"))
        for short, count, below, size in curves:
            speeds = np.asarray(self.reference[0] * 2.0 ** (np.arange(count) - below), dtype=np.float64)
            logs = np.log(_FORMULAS[formula](speeds, self.reference[1], values[size], values))
            found |= {f"{short}_{k}": float(np.clip(log, -3.0, 3.0)) for k, log in enumerate(logs)}
        return found

    def priors(self) -> tuple[Prior, ...]:
        """Keep both curves smooth; of the speed little is known."""
        return (
            *smooth_curve("drag_law.across", _names("across", _KNOTS_D), 0.3, 0.7),
            *smooth_curve("drag_law.along", _names("along", _KNOTS_F), 0.3, 0.7),
            about("drag_law.speeds", [f"drag_law.{k}" for k in ("whole_across", "whole_along", "height")], 0.5, 0.5),
        )
