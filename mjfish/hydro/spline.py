"""A curve by its values at equally spaced knots: cubic between them, constant beyond the ends, once differentiable."""

from __future__ import annotations

from typing import Any

from mjfish.compiled import merged


@merged
def spline_weights(t: float, count: int) -> tuple[int, float, float, float, float]:
    """Return k and the weights of the knots k - 1, k, k + 1, k + 2 at t, in units of the knots' spacing.

    Between knots the curve is the cubic through both values whose slope at an inner knot is that of the chord between
    its neighbours (Catmull and Rom), and zero at the outermost knots, of which there are `count`; beyond, a constant.
    """
    t = min(max(t, 0.0), count - 1.0)
    k = min(int(t), count - 2)
    s = t - k
    rest = 1.0 - s
    left, right = s * rest * rest, -s * s * rest  # of the slopes
    a, b, c, d = 0.0, (1.0 + 2.0 * s) * rest * rest, s * s * (3.0 - 2.0 * s), 0.0
    if k > 0:
        a -= 0.5 * left
        c += 0.5 * left
    if k < count - 2:
        b -= 0.5 * right
        d += 0.5 * right
    return k, a, b, c, d


@merged
def spline(t: float, values: Any, first: int, count: int) -> float:
    """Return the curve at t; its knots stand in `values` from `first` on. See `spline_weights`."""
    k, a, b, c, d = spline_weights(t, count)
    g = b * values[first + k] + c * values[first + k + 1]
    if k > 0:
        g += a * values[first + k - 1]
    if k < count - 2:
        g += d * values[first + k + 2]
    return float(g)
