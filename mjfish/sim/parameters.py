"""Parameters of the water travel in the model itself, as a custom numeric: so threads and many models just work.

Layout, all float64: MAGIC, number n of links, 1 where userdata holds the servo commands; n body ids; n `LINK` records.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from mjfish.arrays import FloatArray, RecordArray
from mjfish.errors import InputError
from mjfish.hydro.link import LINK

#: Name of the numeric; the callback knows it by its first number.
NAME = "strip_fluid"
MAGIC = 7.267091e6
HEADER = 3


def size(links: int) -> int:
    """Return how many numbers `links` links take."""
    return HEADER + links * (1 + LINK.itemsize // 8)


def reserve(spec: mujoco.MjSpec, links: int) -> None:
    """Make room for the parameters of `links` links in a specification."""
    spec.add_numeric(name=NAME, size=size(links), data=np.zeros(size(links)))


def write(model: mujoco.MjModel, bodies: Sequence[str], records: RecordArray, *, commanded: bool = False) -> None:
    """Write the parameters into a compiled model, in place.

    Args:
        model: with room for them, see `reserve`.
        bodies: names of the bodies, one a link.
        records: (n,) `LINK` records.
        commanded: userdata holds the servo commands of each step.
    """
    ids = [model.body(name).id for name in bodies]
    numbers = [[MAGIC, len(ids), float(commanded)], ids, records.view(np.float64).ravel()]
    _data(model)[:] = np.concatenate([np.asarray(part, dtype=np.float64) for part in numbers])


def read(model: mujoco.MjModel) -> tuple[list[int], RecordArray]:
    """Return body ids and `LINK` records (a copy) of the links that the water acts on."""
    data = _data(model)
    count = int(data[1])
    bodies = [int(body) for body in data[HEADER : HEADER + count]]
    return bodies, data[HEADER + count :].copy().view(LINK)


def _data(model: mujoco.MjModel) -> FloatArray:
    try:
        data: FloatArray = model.numeric(NAME).data
    except KeyError:
        raise InputError(f"the model has no numeric '{NAME}', so no water acts on it; build it by sim.model") from None
    return data
