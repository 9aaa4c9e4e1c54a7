"""Load hooks: forces on a link that come from outside the Morison model, called from compiled code by address.

An effect writes ``load(link, parameters) -> (fx, fy, mz)``, the extra force [N] and the moment about the link's front
joint [N m] in the link's frame (x towards the tail), from a `mjfish.hydro.link.LINK` record. Calling by address keeps
the engines' machine code the same whatever is plugged in, and lets a file outside the package take part.
"""

from __future__ import annotations

import dis
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, from_dtype, types
from numba.core import cgutils
from numba.extending import intrinsic

from mjfish.arrays import BoolArray, FloatArray
from mjfish.compiled import c_callback, compiled
from mjfish.hydro.link import LINK, column

#: Most parameters a load may have.
PARAMETERS = 8
_RECORD = from_dtype(LINK)
_SIGNATURE = types.void(types.CPointer(_RECORD), types.CPointer(types.float64), types.CPointer(types.float64))


@dataclass(frozen=True)
class Load:
    """A compiled load.

    Attributes:
        address: of ``void(link*, parameters*, force*)``.
        callback: keeps the code alive.
        fields: names of the fields of a link that it reads.
    """

    address: int
    callback: Any
    fields: frozenset[str] = frozenset(LINK.names or ())

    @functools.cached_property
    def reads(self) -> BoolArray:
        """Which numbers of a link's record it reads, but for the velocity (numbers of `LINK`,)."""
        read = np.zeros(LINK.itemsize // 8, dtype=bool)
        for name in self.fields - set("uvw"):
            read[column(name) : column(name) + int(np.prod(LINK[name].shape))] = True
        return read


def load(function: Callable[[Any, Any], tuple[float, float, float]]) -> Load:
    """Compile ``function(link, parameters) -> (fx, fy, mz)`` to a load that both engines can call."""
    inner = compiled(function)

    def hook(link: Any, parameters: Any, force: Any) -> None:
        fx, fy, mz = inner(carray(link, 1)[0], carray(parameters, PARAMETERS))
        out = carray(force, 3)
        out[0] = fx
        out[1] = fy
        out[2] = mz

    callback = c_callback(_SIGNATURE, cached=False)(hook)
    return Load(address=callback.address, callback=callback, fields=fields_read(function))


def fields_read(function: Callable[..., Any]) -> frozenset[str]:
    """Return the fields of its first argument that a function may read: all, where it does more than name them."""
    every = frozenset(LINK.names or ())
    code = list(dis.get_instructions(function))
    link = function.__code__.co_varnames[0]
    read = set()
    for one, after in itertools.pairwise(code):
        named = one.argval if isinstance(one.argval, tuple) else (one.argval,)
        if one.opname.startswith(("LOAD_FAST", "LOAD_DEREF", "LOAD_CLOSURE", "STORE_FAST")) and link in named:
            if one.opname != "LOAD_FAST" or after.opname != "LOAD_ATTR":
                return every
            read.add(str(after.argval))
    return every & read


def load_table(loads: Sequence[tuple[Load, Sequence[float]]]) -> tuple[Any, FloatArray]:
    """Return addresses (k,) uint64 and parameters (k, PARAMETERS) of loads with their parameters, for `apply_loads`."""
    addresses = np.array([one.address for one, _ in loads], dtype=np.uint64)
    parameters = np.zeros((max(len(loads), 1), PARAMETERS))
    for row, (_, given) in zip(parameters, loads, strict=False):
        row[: len(given)] = given
    return addresses, parameters


@intrinsic  # type: ignore[untyped-decorator]
def _call(_typing: Any, _address: Any, _link: Any, _parameters: Any, _force: Any) -> Any:
    """Call ``void(*)(void*, void*, void*)`` at an address, with three addresses."""
    signature = types.void(types.uintp, types.uintp, types.uintp, types.uintp)

    def codegen(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = cgutils.voidptr_t
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 3).as_pointer()
        function, *values = arguments
        builder.call(builder.inttoptr(function, kind), [builder.inttoptr(value, pointer) for value in values])

    return signature, codegen


@compiled
def apply_loads(
    links: Any, index: int, addresses: Any, parameters: FloatArray, force: FloatArray
) -> tuple[float, float, float]:
    """Sum all loads on link `index`; `addresses` (k,) uint64, `parameters` (k, PARAMETERS), `force` (3,) scratch."""
    fx = 0.0
    fy = 0.0
    mz = 0.0
    for k in range(addresses.shape[0]):
        _call(
            addresses[k],
            np.uint64(links.ctypes.data + index * LINK_SIZE),
            np.uint64(parameters.ctypes.data + 8 * k * PARAMETERS),
            np.uint64(force.ctypes.data),
        )
        fx += force[0]
        fy += force[1]
        mz += force[2]
    return fx, fy, mz


LINK_SIZE = LINK.itemsize
