"""What a coordinate may do over time: a smooth course plus harmonics of the beat.

    c(t) = sum_i s_i B_i(t) + sum_k [a_k cos(2 pi k f t) + b_k sin(2 pi k f t)]

B are quintic B-splines whose prior is that of the smoothing spline of order 6, p(s) ~ exp(-INT c'''^2 dt / (2 q)): a
twice-integrated white acceleration of intensity q ([Wahba1990], ch. 1.5); the harmonics are free. What repeats with
the beat is thus known in a gap too, and what does not is known as far as it is smooth.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from mjfish.arrays import FloatArray, readonly

_DEGREE = 5
#: Knots a beat, and the widest and the narrowest distance of knots [s].
_KNOTS, _WIDEST, _NARROWEST = 11.0, 0.2, 0.03
#: Distance of knots where there is no beat [s].
_WITHOUT = 0.05


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions of time that every coordinate is made of.

    Attributes:
        time: (n,) [s].
        knots: of the splines [s].
        harmonics: how many of the beat.
    """

    time: FloatArray
    knots: FloatArray
    harmonics: int

    @staticmethod
    def of(time: FloatArray, beat: float | None, harmonics: int) -> Basis:
        """Return the basis for times (n,) [s] and a beat [Hz], None where the motion has none."""
        span = float(time[-1] - time[0])
        apart = _WITHOUT if beat is None else float(np.clip(1.0 / (_KNOTS * beat), _NARROWEST, _WIDEST))
        inner = np.linspace(time[0], time[-1], max(int(np.ceil(span / apart)), 4) + 1)
        knots = np.concatenate([np.full(_DEGREE, time[0]), inner, np.full(_DEGREE, time[-1])])
        return Basis(time, readonly(knots), 0 if beat is None else harmonics)

    @property
    def splines(self) -> int:
        """Number of splines."""
        return len(self.knots) - _DEGREE - 1

    @property
    def size(self) -> int:
        """Number of functions."""
        return self.splines + 2 * self.harmonics

    def design(self, beat: float | None, order: int = 0) -> FloatArray:
        """Return the functions (order 0) or their rates (order 1) at the times: (n, size)."""
        columns = [self._splines(order)]
        for k in range(1, self.harmonics + 1):
            omega = 2.0 * np.pi * k * float(beat or 0.0)
            phase = omega * (self.time - self._middle)
            cos, sin = np.cos(phase), np.sin(phase)
            columns.append(np.column_stack([cos, sin] if order == 0 else [-omega * sin, omega * cos]))
        return np.concatenate(columns, axis=1)

    def stretched(self, beat: float | None) -> FloatArray:
        """Return the derivative (n, size) of the functions by the logarithm of the beat."""
        slope = self.design(beat, order=1) * (self.time - self._middle)[:, None]
        slope[:, : self.splines] = 0.0
        return slope

    @property
    def _middle(self) -> float:
        return 0.5 * float(self.time[0] + self.time[-1])

    def _splines(self, order: int) -> FloatArray:
        return _evaluated(self.time.tobytes(), self.knots.tobytes(), order)

    def roughness(self) -> FloatArray:
        """Return INT B_i''' B_j''' dt (splines, splines): piecewise quartic, three Gauss points are exact."""
        ends = np.unique(self.knots)
        points, weights = np.polynomial.legendre.leggauss(3)
        half = 0.5 * np.diff(ends)
        at = (0.5 * (ends[:-1] + ends[1:])[:, None] + half[:, None] * points).ravel()
        third = BSpline(self.knots, np.eye(self.splines), _DEGREE)(at, nu=3)
        return np.asarray((third * (half[:, None] * weights).ravel()[:, None]).T @ third)


@functools.lru_cache(maxsize=8)
def _evaluated(time: bytes, knots: bytes, order: int) -> FloatArray:
    t = np.frombuffer(knots)
    spline = BSpline(t, np.eye(len(t) - _DEGREE - 1), _DEGREE)
    return readonly(spline(np.frombuffer(time), nu=order))
