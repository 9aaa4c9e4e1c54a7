"""Where MuJoCo keeps its numbers in memory, for compiled code: struct layouts and library functions, no C compiler.

MuJoCo ships a description of its own headers (`mujoco.introspect`). From it the offset of every field follows by the
rules of C; `verify` compares some of them with a live model, so that a MuJoCo of another layout is refused.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterable
from operator import attrgetter
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from mujoco.introspect import ast_nodes
from mujoco.introspect.structs import STRUCTS
from numba import from_dtype, types
from numba.extending import intrinsic

from mjfish.errors import MjfishError

_C_TYPES: dict[str, Any] = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
}
_MODEL_FIELDS = (
    "nv", "nu", "na", "nuserdata", "nbody", "opt.timestep", "opt.gravity", "opt.wind", "opt.o_solimp",
    "opt.integrator", "opt.disableflags", "body_rootid", "dof_parentid", "M_rownnz", "M_rowadr", "M_colind",
)  # fmt: skip
_DATA_FIELDS = (
    "time", "nefc", "qvel", "qacc", "qacc_smooth", "ctrl", "act", "userdata", "M", "cdof", "cdof_dot", "cvel", "xpos",
    "xmat", "xipos", "subtree_com", "qfrc_bias", "qfrc_passive", "qfrc_actuator", "qfrc_applied", "xfrc_applied",
)  # fmt: skip


@functools.cache
def structure(name: str) -> type[ctypes.Structure]:
    """Return the ctypes mirror of one of MuJoCo's structs, e.g. ``mjModel``."""
    return _structure(name, STRUCTS[name].fields)


def _structure(name: str, fields: Iterable[Any]) -> type[ctypes.Structure]:
    members = [(field.name, _c_type(f"{name}.{field.name}", field.type)) for field in fields]
    return type(name, (ctypes.Structure,), {"_fields_": members})


def _c_type(place: str, node: Any) -> Any:
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        inner = _c_type(place, node.inner_type)
        for extent in reversed(node.extents):
            inner = inner * extent
        return inner
    if isinstance(node, ast_nodes.AnonymousStructDecl):
        return _structure(place, node.fields)
    if node.name in STRUCTS:
        return structure(node.name)
    if node.name not in _C_TYPES:
        raise MjfishError(
            f"MuJoCo {mujoco.__version__}: {place} has the unknown type '{node.name}'; "
            "install a MuJoCo version that mjfish supports"
        )
    return _C_TYPES[node.name]


def _record(name: str, fields: Iterable[str]) -> types.Record:
    """Return the numba record of the named fields; pointers are integers, a dot reaches into a nested struct."""
    members = {}
    for field in fields:
        kind, offset = np.dtype(structure(name)), 0
        for part in field.split("."):
            kind, inner = dict(kind.fields or {})[part][:2]
            offset += inner
        members[part] = (kind, offset)
    formats, offsets = zip(*members.values(), strict=True)
    layout = {
        "names": list(members),
        "formats": formats,
        "offsets": offsets,
        "itemsize": ctypes.sizeof(structure(name)),
    }
    return from_dtype(np.dtype(layout, align=True))  # type: ignore[call-overload]


MODEL = _record("mjModel", _MODEL_FIELDS)
DATA = _record("mjData", _DATA_FIELDS)


@functools.cache
def verify() -> None:
    """Compare the layout with a live model, once.

    Raises:
        MjfishError: this MuJoCo keeps its numbers elsewhere than its description says.
    """
    model = compile_aside(
        '<mujoco><worldbody><body><joint type="slide"/><geom size="1"/>'
        '<body><joint name="ball" type="ball"/><geom size="1"/></body></body></worldbody>'
        '<actuator><general joint="ball" dyntype="integrator"/></actuator></mujoco>'
    )
    data = mujoco.MjData(model)
    data.time = 0.25  # unlike its neighbours
    for live, struct, fields in ((model, "mjModel", _MODEL_FIELDS), (data, "mjData", _DATA_FIELDS)):
        memory = structure(struct).from_address(live._address)
        for field in fields:
            there, here = attrgetter(field)(live), attrgetter(field)(memory)
            found = there if isinstance(there, (int, float)) else there.ctypes.data
            expected = ctypes.addressof(here) if isinstance(here, ctypes.Array) else here
            if found != expected and getattr(there, "size", 1) > 0:
                raise MjfishError(
                    f"MuJoCo {mujoco.__version__}: {struct}.{field} is not where its headers say; "
                    "install a MuJoCo version that mjfish supports"
                )


def compile_aside(source: str | mujoco.MjSpec) -> mujoco.MjModel:
    """Compile also where a control callback in Python is installed: MuJoCo takes a test step, which fails there.

    One in C stays, for other threads that step meanwhile.
    """
    before = mujoco.get_mjcb_control()
    in_python = before is not None and not hasattr(before, "restype")
    if in_python:
        mujoco.set_mjcb_control(None)
    try:
        return source.compile() if isinstance(source, mujoco.MjSpec) else mujoco.MjModel.from_xml_string(source)
    finally:
        if in_python:
            mujoco.set_mjcb_control(before)


def _load_library() -> ctypes.CDLL:
    """Load libmujoco, and make its functions known to compiled code by name."""
    folder = Path(mujoco.__path__[0])
    found = [path for pattern in ("libmujoco.*", "mujoco.dll") for path in folder.glob(pattern)]
    if not found:
        raise MjfishError(f"{folder}: no libmujoco there; reinstall mujoco (pip install --force-reinstall mujoco)")
    llvmlite.binding.load_library_permanently(str(found[0]))
    return ctypes.CDLL(str(found[0]))


LIBRARY = _load_library()
MODEL_POINTER = types.CPointer(MODEL)
DATA_POINTER = types.CPointer(DATA)


def _function(name: str) -> Any:
    """Return ``void name(const mjModel*, mjData*)`` of libmujoco, for compiled code."""
    return types.ExternalFunction(name, types.void(MODEL_POINTER, DATA_POINTER))


fwd_actuation = _function("mj_fwdActuation")
make_inertia = _function("mj_makeM")
factor_inertia = _function("mj_factorM")
_NUMBERS = types.CPointer(types.float64)
#: ``int mju_cholFactor(mjtNum* mat, int n, mjtNum mindiag)``, and ``void mju_cholSolve(res, mat, vec, n)``.
cholesky = types.ExternalFunction("mju_cholFactor", types.int32(_NUMBERS, types.int32, types.float64))
cholesky_solve = types.ExternalFunction("mju_cholSolve", types.void(_NUMBERS, _NUMBERS, _NUMBERS, types.int32))


def pointer_to(target: types.Type) -> Any:
    """Return an intrinsic that turns an integer address into a pointer to `target`."""

    @intrinsic  # type: ignore[untyped-decorator]
    def cast(_typing: Any, _address: Any) -> Any:
        pointer = types.CPointer(target)

        def codegen(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(pointer))

        return pointer(types.uintp), codegen

    return cast


#: Intrinsics: the pointer at an address.
floats = pointer_to(types.float64)
integers = pointer_to(types.int32)
counts = pointer_to(types.uint64)
addresses = pointer_to(types.int64)
model_at = pointer_to(MODEL)
data_at = pointer_to(DATA)
