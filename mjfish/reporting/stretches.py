"""How a curve is drawn, whatever draws it: where the runs have been and beyond, and between which y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.numerics.arrays import FloatArray

#: Room above and below what is shown, as a share of it.
_MARGIN = 0.35


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of a curve.

    Attributes:
        x, y: (n,) of the curve.
        low, high: (n,) of its band.
        seen: whether the runs have been there.
    """

    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    seen: bool


def stretches(curve: MeasuredCurve) -> list[Stretch]:
    """Return the pieces below, inside and above the visited range; neighbours share an end."""
    x = np.array(curve.x.values)
    at = np.unique([*x, *(curve.seen or ())])
    y, low, high = (np.interp(at, x, values) for values in (curve.y.values, curve.y.low, curve.y.high))
    first, last = curve.seen or (np.inf, np.inf)
    pieces = ((at <= first, False), ((first <= at) & (at <= last), True), (at >= last, False))
    return [Stretch(at[own], y[own], low[own], high[own], seen) for own, seen in pieces if own.sum() > 1]


def span(curve: MeasuredCurve) -> tuple[float, float]:
    """Return the lowest and highest y to show: a band where no run has been may be too wide to be a scale."""
    shown = [stretch for stretch in stretches(curve) if stretch.seen] or stretches(curve)
    every = np.concatenate([curve.nominal, *(stretch.low for stretch in shown), *(stretch.high for stretch in shown)])
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    room = _MARGIN * (high - low) or max(abs(high), 1e-9)
    return low - room, high + room


def logarithmic(curve: MeasuredCurve) -> bool:
    """Return whether x stands on a logarithmic axis: the points of a curve that begins above zero are by ratios."""
    return curve.x.values[0] > 0.0
