"""Loads along a tangent: a load is compiled for real numbers, so that its derivative is taken by differences.

A load is called at states moved along the tangent, x + s t d with s = -2, -1, 1, 2: the central difference of fourth
order in t. t moves the velocity, or else the parameters, by a hundred-thousandth of what they are, so that its error is
about 1e-10 of the derivative where the load is smooth. The value itself is exact.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.link import LINK, column
from mjfish.hydro.load import PARAMETERS, apply_loads

#: Imaginary part of a complex number that stands for a unit of the tangent.
TINY = 1e-30
_SIZE = LINK.itemsize // 8
_REACH = 1e-5  # of a move, relative to what is moved
_SLOWEST = 1e-3  # velocities below this are moved as if they were this [m/s, rad/s]
_U = column("u")
_TABLES = column("node_height")
_STRIPS = column("strip_r")


def loads_on(links: Any, index: int, addresses: Any, parameters: Any, force: FloatArray) -> tuple[Any, Any, Any]:
    """Sum all loads on link `index`; of complex links, with the derivative along their imaginary part."""
    raise NotImplementedError("only in compiled code")


@overload(loads_on)
def _loads_on(links, index, addresses, parameters, force):  # type: ignore[no-untyped-def] # numba compares signatures
    del links, index, addresses, force
    chosen = _along if isinstance(parameters.dtype, types.Complex) else apply_loads

    def call(links, index, addresses, parameters, force):  # type: ignore[no-untyped-def]
        return chosen(links, index, addresses, parameters, force)

    return call


@compiled
def _along(
    links: Any, index: int, addresses: Any, parameters: Any, force: FloatArray
) -> tuple[complex, complex, complex]:
    here = links[index : index + 1].view(np.complex128)
    moved = np.empty(_SIZE)
    record = moved.view(LINK)
    given = np.empty((parameters.shape[0], PARAMETERS))
    t = _length(here, parameters)
    _move(here, parameters, 0.0, moved, given)
    fx, fy, mz = apply_loads(record, 0, addresses, given, force)
    dx = 0.0
    dy = 0.0
    dz = 0.0
    if t > 0.0:
        for s, weight in ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0)):
            _move(here, parameters, s * t, moved, given)
            gx, gy, gz = apply_loads(record, 0, addresses, given, force)
            dx += weight * gx
            dy += weight * gy
            dz += weight * gz
        dx /= t
        dy /= t
        dz /= t
    return complex(fx, TINY * dx), complex(fy, TINY * dy), complex(mz, TINY * dz)


@compiled
def _length(here: Any, parameters: Any) -> float:
    """Return how far to go along the tangent."""
    speed = _SLOWEST
    rate = 0.0
    for k in range(_U, _U + 3):
        speed = max(speed, abs(here[k].real))
        rate = max(rate, abs(here[k].imag) / TINY)
    t = _REACH * speed / rate if rate > 0.0 else np.inf
    for k in range(_TABLES):
        if (k < _U or k >= _U + 3) and here[k].imag != 0.0:
            t = min(t, _REACH * max(abs(here[k].real), 1e-6) / (abs(here[k].imag) / TINY))
    for k in range(_STRIPS, _SIZE):
        if here[k].imag != 0.0:
            t = min(t, _REACH * max(abs(here[k].real), 1e-6) / (abs(here[k].imag) / TINY))
    for j in range(parameters.shape[0]):
        for k in range(PARAMETERS):
            if parameters[j, k].imag != 0.0:
                t = min(t, _REACH * max(abs(parameters[j, k].real), 1.0) / (abs(parameters[j, k].imag) / TINY))
    return t if t < np.inf else 0.0


@compiled
def _move(here: Any, parameters: Any, t: float, moved: FloatArray, given: FloatArray) -> None:
    """Fill record and parameters at `t` along the tangent; the tables of moments are none of a load's business."""
    along = t / TINY
    for k in range(_TABLES):
        moved[k] = here[k].real + along * here[k].imag
    for k in range(_STRIPS, _SIZE):
        moved[k] = here[k].real + along * here[k].imag
    for j in range(parameters.shape[0]):
        for k in range(PARAMETERS):
            given[j, k] = parameters[j, k].real + along * parameters[j, k].imag
