"""A curve by the coefficients of cubic B-splines: twice differentiable, constant beyond its ends.

[DeBoor1978] C. de Boor, A Practical Guide to Splines, ch. 9.
"""

from __future__ import annotations

from typing import Any

from mjfish.numerics.compiled import merged


@merged
def spline_weights(t: float, count: int) -> tuple[int, float, float, float, float]:
    """Return k and the weights of the coefficients k - 1, k, k + 1, k + 2 at t, in units of the knots' spacing.

    Uniform cubic B-splines [DeBoor1978]. Beyond the ends the coefficients are mirrored, so that the curve ends level;
    of `count` coefficients, those behind an end have no weight of their own.
    """
    t = min(max(t, 0.0), count - 1.0)
    k = min(int(t), count - 2)
    s = t - k
    rest = 1.0 - s
    a, d = rest**3 / 6.0, s**3 / 6.0
    b = (4.0 - 3.0 * s * s * (1.0 + rest)) / 6.0
    c = (4.0 - 3.0 * rest * rest * (1.0 + s)) / 6.0
    if k == 0:
        c += a
        a = 0.0
    if k == count - 2:
        b += d
        d = 0.0
    return k, a, b, c, d


@merged
def spline(t: float, values: Any, first: int, count: int) -> float:
    """Return the curve at t; its coefficients stand in `values` from `first` on. See `spline_weights`."""
    k, a, b, c, d = spline_weights(t, count)
    g = b * values[first + k] + c * values[first + k + 1]
    if k > 0:
        g += a * values[first + k - 1]
    if k < count - 2:
        g += d * values[first + k + 2]
    return float(g)


@merged
def spline_slope(t: float, values: Any, first: int, count: int) -> float:
    """Return the slope of the curve at t, in units of the knots' spacing; zero beyond the ends."""
    if t <= 0.0 or t >= count - 1.0:
        return 0.0
    k = first + min(int(t), count - 2)
    s = t - (k - first)
    rest = 1.0 - s
    before = values[k - 1] if k > first else values[first + 1]
    after = values[k + 2] if k < first + count - 2 else values[k]
    g = 0.5 * s * ((3.0 * s - 4.0) * values[k] + s * after)
    return float(g + 0.5 * rest * ((4.0 - 3.0 * rest) * values[k + 1] - rest * before))
