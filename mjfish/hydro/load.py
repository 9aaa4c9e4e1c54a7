"""Loads: forces on a link that come from outside the Morison model, called from compiled code by address.

An effect writes ``load(link, parameters) -> (fx, fy, mz)``, the extra force [N] and the moment about the link's front
joint [N m] in the link's frame (x towards the tail), from a `mjfish.hydro.link.LINK` record. Calling by address keeps
the engines' machine code the same whatever is plugged in, and lets a file outside the package take part.
"""

from __future__ import annotations

import dis
import functools
import itertools
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

import cloudpickle
import numpy as np
from llvmlite import ir
from numba import carray, from_dtype, literal_unroll, types
from numba.core import cgutils
from numba.extending import intrinsic

from mjfish.errors import ParameterError
from mjfish.hydro.link import LINK, MEMORY, MOVING, column
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.compiled import c_callback, is_ours, merged, part

#: Most parameters a load may have.
PARAMETERS = 18
#: A row of a `LoadTable`: parameters; number of hidden states that a link works on, where they begin in the state, and
#: how many further on those of the next link begin, 0 where all links share them; 0 where the force depends on the
#: velocity only, 1 where it is stateful, 2 where it is stateful and exerts nothing (inactive); address of its gradient,
#: 0 where it has none; the columns of a gradient that are taken by differences, as the bits of a whole number.
AT_MEMORY, AT_FIRST, AT_STRIDE, AT_STATEFUL, AT_GRADIENT, AT_WANTED, ROW = range(PARAMETERS, PARAMETERS + 7)
#: Numbers of the motion of a link that a load may depend on.
MOTION = ("u", "v", "w", "x", "y", "heading", "bend")
PLACES = len(MOTION)
#: Columns of a gradient: the parameters, then the motion, then the hidden states.
SLOPES = PARAMETERS + PLACES + MEMORY
#: Most numbers that a load returns.
ANSWER = 3 + MEMORY
LINK_SIZE = LINK.itemsize
_COMPILING = threading.RLock()
_COLOUR, _LONGEST = re.compile(r"\x1b\[\d*m"), 200
_RECORD = from_dtype(LINK)
_SIGNATURE = types.void(types.CPointer(_RECORD), types.CPointer(types.float64), types.CPointer(types.float64))


class LoadTable(NamedTuple):
    """Loads with their parameters, for compiled code.

    Attributes:
        addresses: (k,) uint64 of the callbacks.
        rows: (k, ROW), one row at least.
    """

    addresses: Any
    rows: FloatArray


class LoadBuffers(NamedTuple):
    """Where loads find their hidden states, and where their answers go.

    Attributes:
        output: (ANSWER,) scratch of one call.
        state: (STATES + hidden,), read.
        rates: (STATES + hidden,), the rates of the hidden states, written.
    """

    output: FloatArray
    state: Any
    rates: Any


@dataclass(frozen=True, eq=False)
class Load:
    """A load, compiled when its address is first asked for.

    Attributes:
        function: of a link and parameters, see `load`.
        memory: hidden states it has on each link.
        shared: whether it has them once for the whole fish; their rates are then the sums over the links.
        slopes: writes its derivatives, see `load`; None: has none.
    """

    function: Callable[[Any, Any], tuple[float, ...]]
    memory: int = 0
    shared: bool = False
    slopes: Callable[[Any, Any, Any], None] | None = None

    @property
    def address(self) -> int:
        """Address of ``void(link*, parameters*, force*)``."""
        return int(_callback(self).address)

    @property
    def gradient(self) -> int:
        """Address of ``void(link*, parameters*, gradient*)``, of its derivatives; 0: has none."""
        callback = _gradient(self)
        return 0 if callback is None else int(callback.address)

    @functools.cached_property
    def fields(self) -> frozenset[str]:
        """Names of the fields of a link that it reads."""
        return fields_read(self.function)

    def __reduce__(self) -> Any:
        """Return how another process gets it: always the same one, so that its functions are compiled there once."""
        return _from_another_process, (cloudpickle.dumps((self.function, self.slopes)), self.memory, self.shared)

    @property
    def placed(self) -> bool:
        """Whether it reads the place of the link, its heading or its bend."""
        return not self.fields.isdisjoint(("x", "y", "heading", "bend"))

    @property
    def stateful(self) -> bool:
        """Whether its force depends on more of the motion than the velocity of the link: on its place, or its past."""
        return self.memory > 0 or self.placed

    @property
    def moving(self) -> int:
        """The columns of its gradient that belong to what it reads of the motion, as bits."""
        return sum(1 << PARAMETERS + k for k, name in enumerate(MOTION) if name in self.fields)

    @functools.cached_property
    def reads(self) -> BoolArray:
        """Which numbers of a link's record it reads, but for what the kernel writes (numbers of `LINK`,)."""
        read = np.zeros(LINK.itemsize // 8, dtype=bool)
        for name in self.fields - MOVING:
            read[column(name) : column(name) + int(np.prod(LINK[name].shape))] = True
        return read


@functools.cache
def _from_another_process(functions: bytes, memory: int, shared: bool) -> Load:
    function, gradient = cloudpickle.loads(functions)
    return load(function, memory=memory, shared=shared, gradient=gradient)


@overload
def load(
    function: Callable[[Any, Any], tuple[float, ...]],
    *,
    memory: int = 0,
    shared: bool = False,
    gradient: Callable[[Any, Any, Any], None] | None = None,
) -> Load: ...


@overload
def load(
    *, memory: int = 0, shared: bool = False, gradient: Callable[[Any, Any, Any], None] | None = None
) -> Callable[[Callable[[Any, Any], tuple[float, ...]]], Load]: ...


def load(
    function: Callable[[Any, Any], tuple[float, ...]] | None = None,
    *,
    memory: int = 0,
    shared: bool = False,
    gradient: Callable[[Any, Any, Any], None] | None = None,
) -> Any:
    """Make ``function(link, parameters) -> (fx, fy, mz)`` a load; ``@load``, or ``@load(memory=2)``.

    Args:
        function: the load; with a memory it returns the rates of its hidden states behind (fx, fy, mz).
        memory: hidden states on each link, at most MEMORY, zero at the start; read in ``link.memory``.
        shared: the fish has them once, and every link returns what it adds to their rates.
        gradient: ``gradient(link, parameters, out)`` writes the derivatives of what the load returns into out
            (3 + memory, SLOPES), which is full of zeros before. Columns: the parameters; from PARAMETERS on u, v, w, x,
            y, heading, bend; then the hidden states. What is not written counts as zero, and nothing checks it.

    Raises:
        ParameterError: more memory than there is.
    """
    if function is None:
        return lambda decorated: load(decorated, memory=memory, shared=shared, gradient=gradient)
    if not 0 <= memory <= MEMORY:
        raise ParameterError(f"a load with memory = {memory}; give 0 to {MEMORY}")
    return Load(function, memory, shared, gradient)


def _once(make: Callable[[Load], Any]) -> Callable[[Load], Any]:
    """Keep what is made of a load as long as the load: its address may be called. Threads wait for each other."""

    def ask(load_: Load) -> Any:
        kept = vars(load_)
        with _COMPILING:
            if make.__name__ not in kept:
                try:
                    kept[make.__name__] = make(load_)
                except Exception as error:  # numba's errors have no base but this one
                    raise ParameterError(
                        f"the load '{load_.function.__name__}' cannot be compiled: {_reason(error)}; write it of "
                        "numbers, math and numpy, the fields of a link and the parameters, and put imports at the top "
                        "of its file"
                    ) from error
            return kept[make.__name__]

    return ask


def _reason(error: Exception) -> str:
    """Return in one line what the compiler says; its own lines about where it was come first, in colours."""
    told = next(
        (
            line
            for line in _COLOUR.sub("", str(error)).splitlines()
            if line.strip() and not line.startswith("Failed in")
        ),
        "",
    )
    return told[:_LONGEST] if type(error).__module__.startswith("numba.") else f"{type(error).__name__}: {told}"


@_once
def _callback(load_: Load) -> Any:
    inner = part(load_.function, allocates=True)
    wide = 3 + load_.memory

    def plain(link: Any, parameters: Any, force: Any) -> None:
        fx, fy, mz = inner(carray(link, 1)[0], carray(parameters, PARAMETERS))
        out = carray(force, 3)
        out[0] = fx
        out[1] = fy
        out[2] = mz

    def remembering(link: Any, parameters: Any, force: Any) -> None:
        out = carray(force, wide)
        k = 0
        for number in literal_unroll(inner(carray(link, 1)[0], carray(parameters, PARAMETERS))):
            out[k] = number
            k += 1  # noqa: SIM113 # numba unrolls no enumerate

    return c_callback(_SIGNATURE, cached=is_ours(load_.function))(remembering if load_.memory else plain)


@_once
def _gradient(load_: Load) -> Any:
    if load_.slopes is None:
        return None
    inner, wide = part(load_.slopes, allocates=True), 3 + load_.memory

    def sloping(link: Any, parameters: Any, out: Any) -> None:
        slopes = carray(out, (wide, SLOPES))
        slopes[:] = 0.0
        inner(carray(link, 1)[0], carray(parameters, PARAMETERS), slopes)

    return c_callback(_SIGNATURE, cached=is_ours(load_.slopes))(sloping)


#: Instructions end in these where the last thing that they do is to load a name.
_LOADS = ("LOAD_FAST", "LOAD_FAST_BORROW")


def fields_read(function: Callable[..., Any]) -> frozenset[str]:
    """Return the fields of its first argument that a function may read: all, where it does more than name them."""
    every = frozenset(LINK.names or ())
    code = list(dis.get_instructions(function))
    link = function.__code__.co_varnames[0]
    read = set()
    for instruction, following in itertools.pairwise(code):
        names = instruction.argval if isinstance(instruction.argval, tuple) else (instruction.argval,)
        if instruction.opname.startswith(("LOAD_FAST", "LOAD_DEREF", "LOAD_CLOSURE", "STORE_FAST")) and link in names:
            # From Python 3.13 on, one instruction may load or store two names: the last one is what is read of.
            read_of = names[-1] == link and names.count(link) == 1 and instruction.opname.endswith(_LOADS)
            if not read_of or following.opname != "LOAD_ATTR":
                return every
            read.add(str(following.argval))
    return every & read


def load_rows(
    loads: Sequence[tuple[Load, Sequence[float]]], links: int = 0, first: int = 0, inactive: Sequence[Load] = ()
) -> LoadTable:
    """Return the table of loads with their parameters, for `loads_on`.

    Args:
        loads: with their parameters.
        links: number of links of the fish.
        first: where the hidden states of the loads begin in the state: load by load, then link by link.
        inactive: those of the loads that exert nothing now.
    """
    addresses = np.array([load_.address for load_, _ in loads], dtype=np.uint64)
    rows = np.zeros((max(len(loads), 1), ROW))
    for row, (load_, numbers) in zip(rows, loads, strict=False):
        if len(numbers) > PARAMETERS:
            raise ParameterError(
                f"a load with {len(numbers)} numbers; parameters and constants may be {PARAMETERS} at most"
            )
        row[: len(numbers)] = numbers
        row[AT_MEMORY], row[AT_FIRST], row[AT_STRIDE] = load_.memory, first, 0 if load_.shared else load_.memory
        row[AT_GRADIENT] = load_.gradient  # exact: addresses have fewer bits than the fraction of a float
        row[AT_STATEFUL] = (2.0 if load_ in inactive else 1.0) if load_.stateful else 0.0
        row[AT_WANTED] = load_.moving
        first += memory_of([(load_, ())], links)
    return LoadTable(addresses, rows)


def memory_of(loads: Sequence[tuple[Load, Sequence[float]]], links: int) -> int:
    """Return how many hidden states the loads have on all links."""
    return sum(load_.memory * (1 if load_.shared else links) for load_, _ in loads)


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


@merged
def call(address: Any, links: Any, link: int, row: FloatArray, out: FloatArray) -> None:
    """Call a load or its gradient on one link, with the memory that its record has; write its answer into `out`."""
    _call(
        address,
        np.uint64(links.ctypes.data + link * LINK_SIZE),
        np.uint64(row.ctypes.data),
        np.uint64(out.ctypes.data),
    )


@merged
def clear_shared(rows: FloatArray, rates: Any) -> None:
    """Set the rates of hidden states that all links share to zero, before one link alone adds to them."""
    for k in range(rows.shape[0]):
        if rows[k, AT_STRIDE] == 0.0:
            first = int(rows[k, AT_FIRST])
            for m in range(int(rows[k, AT_MEMORY])):
                rates[first + m] = 0.0


@merged
def loads_on(
    links: Any, record: int, link: int, table: LoadTable, velocity_only: bool, buffers: LoadBuffers
) -> tuple[float, float, float]:
    """Sum all loads on a link; write the rates of their hidden states.

    Args:
        links: `LINK` records.
        record: index of the record that the loads are called with.
        link: index of the link of the fish that it stands for.
        table: the loads.
        velocity_only: leave out the stateful ones.
        buffers: hidden states and their rates.
    """
    fx, fy, mz = 0.0, 0.0, 0.0
    addresses, rows = table.addresses, table.rows
    called = links[record]
    for k in range(addresses.shape[0]):
        memory = int(rows[k, AT_MEMORY])
        if (velocity_only and rows[k, AT_STATEFUL] > 0.0) or (memory == 0 and rows[k, AT_STATEFUL] > 1.0):
            continue
        first = int(rows[k, AT_FIRST]) + link * int(rows[k, AT_STRIDE])
        added = link > 0 and rows[k, AT_STRIDE] == 0.0
        for m in range(memory):
            called.memory[m] = buffers.state[first + m]
        call(addresses[k], links, record, rows[k], buffers.output)
        for m in range(memory):
            buffers.rates[first + m] = buffers.output[3 + m] + (buffers.rates[first + m] if added else 0.0)
        fx += buffers.output[0]
        fy += buffers.output[1]
        mz += buffers.output[2]
    return fx, fy, mz
