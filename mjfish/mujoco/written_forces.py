"""What the water wrote into which mjData: to take it out again where the water acts no longer.

MuJoCo keeps `xfrc_applied` until somebody writes it: the last force of the water would push for ever, and the hidden
states of loads would go on at the rates that stand in `ctrl`. MuJoCo steps any
number of mjData in any thread and names them to the callback only. So the callback notes each mjData when it meets it
first (`_note`, in Python, and what was there before) and then what it writes there (`copy_written`). An mjData
that is freed meanwhile must not be touched: while notes are taken, MuJoCo's hook `mju_user_free` strikes it off.
"""

from __future__ import annotations

import ctypes
import sys
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import carray, types

from mjfish.mujoco.layout import LIBRARY, addresses, data_at, floats, structure
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled

#: Of a note, for each body: whether the water wrote on it, the six numbers that it wrote last, and those before it.
_NOTE = 13
_SLOTS = 1 << 14  # a power of two
_FREED = 1
#: Hash table by the address of an mjData, with open addressing: that address, 0 or _FREED; address of its note.
TABLE = np.zeros((_SLOTS, 2), dtype=np.int64)
#: By address of the mjData: its note, and index of the first rate of a hidden state in `ctrl` and their number.
_notes: dict[int, tuple[FloatArray, int, int]] = {}
#: By address of an mjData that the water acted on in a block before: how many steps it had taken when that ended.
_left: dict[int, int] = {}
#: How many steps an mjData took between two blocks, at most.
_dry = 0
#: The rows that are not 0: the whole table takes longer to clear than a step takes.
_rows: list[int] = []

_FREE_TYPE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_hook = ctypes.c_void_p.in_dll(LIBRARY, "mju_user_free")
_hook_before: int | None = None
_NOTE_SYMBOL = "mjfish_note_data"
_take_note = types.ExternalFunction(_NOTE_SYMBOL, types.void(types.int64, types.int64, types.int64, types.int64))


@compiled
def _row(table: Any, address: int) -> int:
    """Return the row of an mjData, or -1."""
    for probe in range(_SLOTS):
        row = ((address >> 6) * 40503 + probe) & (_SLOTS - 1)
        if table[row, 0] == address:
            return row
        if table[row, 0] == 0:
            break
    return -1


@compiled
def note_of(table_address: int, address: Any, data: Any, water: Any) -> int:
    """Return the address of the note of an mjData, which the water is about to write to; 0 where there is no room.

    Args:
        table_address: of `TABLE`.
        address: of the mjData.
        data: its record.
        water: on its model, `mjfish.mujoco.block.Water`.
    """
    table = carray(addresses(table_address), (_SLOTS, 2))
    row = _row(table, address)
    if row < 0:
        _take_note(address, water.head[0].bodies, water.head[0].control, water.head[0].states)
        row = _row(table, address)
        if row >= 0:
            written = carray(floats(table[row, 1]), (water.head[0].bodies, _NOTE))
            written[:, 7:] = carray(floats(data.xfrc_applied), (water.head[0].bodies, 6))
    return table[row, 1] if row >= 0 else 0


@compiled
def copy_written(note: int, data: Any, water: Any) -> None:
    """Copy what the water wrote on its bodies into the note at an address."""
    if note == 0:
        return
    written = carray(floats(note), (water.head[0].bodies, _NOTE))
    for i in range(water.links.shape[0]):
        body = int(water.links[i].body)
        written[body, 0] = 1.0
        written[body, 1:7] = carray(floats(data.xfrc_applied + 48 * body), 6)


def _note(address: int, bodies: int, control: int, states: int) -> None:
    """Note an mjData that the water has not met before and is about to write to."""
    global _dry
    steps = _steps(address)
    left = _left.pop(address, steps)
    if steps > left and not _may_be_copied(steps):
        _dry = max(_dry, steps - left)
    for probe in range(_SLOTS):
        row = ((address >> 6) * 40503 + probe) & (_SLOTS - 1)
        if TABLE[row, 0] <= _FREED:
            written = np.zeros((bodies, _NOTE))
            _notes[address] = written, control, states
            _rows.append(row)
            TABLE[row] = address, written.ctypes.data
            return


def _may_be_copied(steps: int) -> bool:
    """Return whether an mjData with so many steps may be a copy: of one that was left so, or of one in this block.

    It then lies where another one was freed between two blocks, of which nobody is told.
    """
    return steps in _left.values() or any(steps <= _steps(other) for other in _notes)


_TIMER = structure("mjTimerStat")
#: Of MuJoCo's count of the steps of an mjData, which no state holds: only a step changes it, a reset and a copy.
_STEPS: int = (
    structure("mjData").timer.offset + int(mujoco.mjtTimer.mjTIMER_STEP) * ctypes.sizeof(_TIMER) + _TIMER.number.offset
)


def _steps(address: int) -> int:
    return ctypes.c_int.from_address(address + _STEPS).value


_note_callback = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(_note)
llvmlite.binding.add_symbol(_NOTE_SYMBOL, ctypes.cast(_note_callback, ctypes.c_void_p).value)


def _free(address: int) -> None:
    """Free memory as MuJoCo would; an mjData that lay there is struck off."""
    _left.pop(address, None)
    if _notes.pop(address, None) is not None:
        TABLE[_row(TABLE, address), 0] = _FREED
    if _hook_before:
        _FREE_TYPE(_hook_before)(address)
    elif sys.platform == "win32":
        ctypes.CDLL("ucrtbase")._aligned_free(ctypes.c_void_p(address))
    else:
        ctypes.CDLL(None).free(ctypes.c_void_p(address))


_free_callback = _FREE_TYPE(_free)
_FREE_ADDRESS = ctypes.cast(_free_callback, ctypes.c_void_p).value


def start() -> None:
    """Watch for mjData that are freed."""
    global _hook_before
    _hook_before = _hook.value
    _hook.value = _FREE_ADDRESS


def take_out() -> int:
    """Take what the water wrote out of every living mjData it met: on its bodies is again what was there before it.

    A body on which somebody else has written since then is left alone. Hidden states of loads stand still from now on.

    Returns:
        How many steps an mjData took between the block before and this one, without water.
    """
    global _dry
    _hook.value = _hook_before
    if len(_left) > _SLOTS:
        _left.clear()
    for address, (written, control, states) in _notes.items():
        _take_out(address, written, control, states)
        _left[address] = _steps(address)
    _notes.clear()
    for row in _rows:
        TABLE[row] = 0
    _rows.clear()
    dry, _dry = _dry, 0
    return dry


@compiled
def _take_out(address: int, written: FloatArray, control: int, states: int) -> None:
    """Take what the water wrote out of one mjData."""
    data = carray(data_at(address), 1)[0]
    carray(floats(data.ctrl + 8 * control), states)[:] = 0.0
    applied = carray(floats(data.xfrc_applied), (written.shape[0], 6))
    for body in range(written.shape[0]):
        now, last = applied[body], written[body, 1:7]
        if written[body, 0] > 0.0 and np.all((now == last) | (np.isnan(now) & np.isnan(last))):
            now[:] = written[body, 7:]
