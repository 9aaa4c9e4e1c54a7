"""Cosines and sines of many angles at once.

The C library takes one angle at a call. Here it is a loop without calls, which LLVM vectorises: Taylor series up to an
eighth of a turn, where their last terms are below rounding, after the nearest whole number of quarter turns is taken
off. Both are within 2e-16 of the exact ones up to a million turns.
"""

from __future__ import annotations

import math

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled

#: A quarter turn in three parts, the first two of so few digits that their products with whole numbers are exact.
_QUARTER = math.pi / 2.0
_FIRST = float(np.float32(_QUARTER))
_SECOND = float(np.float32(_QUARTER - _FIRST))
_THIRD = (_QUARTER - _FIRST - _SECOND) + 6.123233995736766e-17  # of pi / 2 beyond the digits of a float
#: Taylor coefficients of sin x / x and cos x in powers of x^2.
_SIN = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))
_COS = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(10))


def cos_sin(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosines and sines of angles [rad] of any shape."""
    cos, sin = np.empty(angle.shape), np.empty(angle.shape)
    _cos_sin(angle.reshape(-1), cos.reshape(-1), sin.reshape(-1))
    return cos, sin


@compiled
def _cos_sin(angle: FloatArray, cos: FloatArray, sin: FloatArray) -> None:
    for i in range(angle.shape[0]):
        turns = np.floor(angle[i] / _QUARTER + 0.5)
        x = ((angle[i] - turns * _FIRST) - turns * _SECOND) - turns * _THIRD
        xx = x * x
        s, c = 0.0, 0.0
        for k in range(len(_SIN) - 1, 0, -1):
            s = (s + _SIN[k]) * xx
        for k in range(len(_COS) - 1, 1, -1):
            c = (c + _COS[k]) * xx
        s, c = x + x * s, 1.0 - (0.5 * xx - c * xx)
        half_turns = np.floor(0.5 * turns)
        odd = turns != 2.0 * half_turns
        sign = 1.0 if half_turns == 2.0 * np.floor(0.5 * half_turns) else -1.0
        cos[i] = -sign * s if odd else sign * c
        sin[i] = sign * c if odd else sign * s
