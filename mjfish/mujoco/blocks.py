"""Where the water of a model lies in memory, and how the callback finds it from the model alone.

MuJoCo's control callback is given a model and its data and nothing else; models are copied (by `copy.copy`, by
`mujoco.batch`), and several are stepped at once. So a model carries a tag: MuJoCo's override of contact parameters,
`opt.o_solimp`, is five numbers that nothing reads while contacts are not overridden, and that every copy keeps. The
tag leads to a row of a table, the row to a block of numbers. A tag whose block is gone, or of another process, leads
nowhere, and the callback then spoils the step visibly instead of leaving the model dry.
"""

from __future__ import annotations

import secrets
import threading
import weakref

import mujoco
import numpy as np

from mjfish.arrays import FloatArray
from mjfish.errors import InputError, MjfishError

#: First number of a tag: no one's contact parameter.
MAGIC = 7267091.0
#: Second number: of this process only.
TOKEN = float(secrets.randbits(52))
_ROWS = 1 << 16
#: First row: the token. Then a row each: address of the block, or 0; how often the row was given away.
TABLE = np.zeros((_ROWS, 2), dtype=np.uint64)
TABLE[0, 0] = np.uint64(TOKEN)

_lock = threading.RLock()  # the collector may free a block while one is made
_free = list(range(_ROWS - 1, 0, -1))


class Block:
    """The numbers of one model's water, at an address that stays; its row of the table is freed with it."""

    def __init__(self, numbers: FloatArray, kept: object = None) -> None:
        """Give the numbers a row.

        Args:
            numbers: (k,) of float64; from now on the block's own.
            kept: lives as long as the block: what addresses among the numbers lead to.

        Raises:
            MjfishError: the table is full.
        """
        self.numbers = numbers
        self._kept = kept
        with _lock:
            if not _free:
                raise MjfishError(f"{_ROWS} models with water live at once; drop some of them")
            self._row = _free.pop()
        TABLE[self._row, 1] += np.uint64(1)
        TABLE[self._row, 0] = numbers.ctypes.data
        _living[self._row] = self
        weakref.finalize(self, _release, self._row)

    def tag(self, model: mujoco.MjModel) -> None:
        """Write the tag into a model; the block lives as long as that model does, whoever else lets go of it."""
        model.opt.o_solimp[:] = (MAGIC, TOKEN, self._row, float(TABLE[self._row, 1]), 0.0)
        _of_model[model] = self


#: The block each living model was last tagged with.
_of_model: weakref.WeakKeyDictionary[mujoco.MjModel, Block] = weakref.WeakKeyDictionary()


#: The living blocks by row.
_living: weakref.WeakValueDictionary[int, Block] = weakref.WeakValueDictionary()


def numbers(model: mujoco.MjModel) -> FloatArray:
    """Return the numbers of the water that a model is tagged with.

    Raises:
        InputError: there is none.
    """
    magic, token, row, count, _ = model.opt.o_solimp
    block = _living.get(int(row)) if magic == MAGIC and token == TOKEN else None
    if block is None or TABLE[int(row), 1] != count:
        raise InputError("no water acts on this model; put it there by StripFluid(model, links)")
    return block.numbers


def _release(row: int) -> None:
    TABLE[row, 0] = 0
    with _lock:
        _free.append(row)
