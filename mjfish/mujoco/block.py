"""The numbers that describe a model's water: one block of memory a model, which compiled code finds from the model.

MuJoCo's control callback is given a model and its data and nothing else; models are copied (by `copy.copy`, by
`mujoco.batch`), and several are stepped at once. So a model carries a tag: MuJoCo's override of contact parameters,
`opt.o_solimp`, is five numbers that nothing reads while contacts are not overridden, and that every copy keeps. The
tag leads to a row of a table, the row to a block of numbers. A tag whose block is gone, or of another process, leads
nowhere, and the callback then spoils the step visibly instead of leaving the model dry.

A block is a record HEADER and the arrays that it leads to. `view` reads it in compiled code.
"""

from __future__ import annotations

import secrets
import threading
import weakref
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import carray, from_dtype

from mjfish.errors import InputError, MjfishError
from mjfish.fish.outline import LinkOutline, outline
from mjfish.hydro.link import LINK, SPATIAL
from mjfish.hydro.load import ROW, Load, LoadTable, load_rows, memory_of
from mjfish.mujoco.layout import counts, floats, pointer_to
from mjfish.mujoco.links import BluntLink, Link, StripLink
from mjfish.mujoco.memory import Room, room_in
from mjfish.numerics.arrays import FloatArray, RecordArray
from mjfish.numerics.compiled import compiled

#: Arrays of a block.
_ARRAYS = ("carriers", "trees", "links", "addresses", "rows", "planes")
#: 1 for the coupling "inertia", 0 for "xfrc"; 1 where userdata holds the servo commands; number of bodies, dofs,
#: actuators and activations of the model, by which a tag on another model is seen; 1 where a load reads the place of
#: its link; `mjfish.mujoco.memory.Room`; address and length of every array.
HEADER = np.dtype(
    [
        (name, "i8")
        for name in (
            "inertia", "commanded", "bodies", "dofs", "actuators", "activations", "placed",
            *Room._fields, *(f"{name}_at" for name in _ARRAYS), *_ARRAYS,
        )
    ]
)  # fmt: skip
#: Id of the body, row of its parent or -1, first dof, number of dofs.
CARRIER = 4
#: First dof, number of dofs.
TREE = 2

#: First number of a tag: no contact parameter that anybody uses.
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
    """The water of one model, at an address that stays; its row of the table is freed with it.

    Attributes:
        header: (1,) of `HEADER`.
        carriers: (c, CARRIER), all bodies of the trees that water acts on, parents first.
        trees: (t, TREE), those trees.
        links: (n,) of `SPATIAL`.
        loads: k of them.
        planes: (n,) of `LINK`, for loads to read; none without loads.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        links: Sequence[Link],
        density: float,
        *,
        inertia: bool,
        commanded: bool,
        loads: Sequence[tuple[Load, Sequence[float]]] = (),
    ) -> None:
        """Describe the water on `links` of `model`, every body of which must be in it, and give it a row.

        Args:
            model: the model.
            links: the links.
            density: of the water [kg/m3].
            inertia: whether the coupling is "inertia", else "xfrc" (`mjfish.mujoco.coupling`).
            commanded: whether userdata holds the servo commands of each step.
            loads: extra forces on every link, with their parameters; they live as long as the block.

        Raises:
            MjfishError: the table is full.
        """
        bodies = [model.body(link.body).id for link in links]
        self.carriers, self.trees = carriers(model, bodies)
        self.links = records(links, density)
        self.links["body"] = bodies
        self.links["carrier"] = np.searchsorted(self.carriers[:, 0], bodies)
        self.loads = load_rows(loads, len(links))
        self._called = loads
        strips = [link for link in links if isinstance(link, StripLink)] if loads else []
        self.planes = plane_records(model, strips, density)
        placed = any(load.placed for load, _ in loads)
        room = room_in(model, memory_of(loads, len(links)))
        arrays = (self.carriers, self.trees, self.links, *self.loads, self.planes)
        sizes = (model.nbody, model.nv, model.nu, model.na)
        addresses = (array.ctypes.data for array in arrays)
        self.header = np.array([(inertia, commanded, *sizes, placed, *room, *addresses, *map(len, arrays))], HEADER)
        with _lock:
            if not _free:
                raise MjfishError(f"{_ROWS} models with water live at once; drop some of them")
            self._row = _free.pop()
        TABLE[self._row, 1] += np.uint64(1)
        TABLE[self._row, 0] = self.header.ctypes.data
        _living[self._row] = self
        weakref.finalize(self, _release, self._row)

    def tag(self, model: mujoco.MjModel) -> None:
        """Write the tag into a model; the block lives as long as that model does, whoever else lets go of it."""
        model.opt.o_solimp[:] = (MAGIC, TOKEN, self._row, float(TABLE[self._row, 1]), 0.0)
        _of_model[model] = self

    def set_coefficients(self, links: Sequence[Link]) -> None:
        """Write the coefficients of `links`; all else of them must be as it was."""
        _fill_coefficients(self.links, links)
        if len(self.planes):
            _fill_coefficients(self.planes, links)


#: The block each living model was last tagged with.
_of_model: weakref.WeakKeyDictionary[mujoco.MjModel, Block] = weakref.WeakKeyDictionary()
#: The living blocks by row.
_living: weakref.WeakValueDictionary[int, Block] = weakref.WeakValueDictionary()


def block_of(model: mujoco.MjModel) -> Block:
    """Return the water that a model is tagged with.

    Raises:
        InputError: there is none, or none any more.
    """
    magic, token, row, count, _ = model.opt.o_solimp
    if magic != MAGIC:
        raise InputError("this model has no water; put it there by StripFluid(model, links)")
    block = _living.get(int(row)) if token == TOKEN else None
    if block is None or TABLE[int(row), 1] != count:
        raise InputError(
            "the StripFluid of this model is gone; keep it as long as copies of its model run, or call "
            "StripFluid(model, links) on this one"
        )
    return block


def _release(row: int) -> None:
    TABLE[row, 0] = 0
    with _lock:
        _free.append(row)


def records(links: Sequence[Link], density: float) -> RecordArray:
    """Return one `SPATIAL` record a link; the ids of bodies are not in it yet."""
    filled = np.zeros(len(links), dtype=SPATIAL)
    for record, link in zip(filled, links, strict=True):
        record["density"] = density
        record["origin"] = link.origin
        if isinstance(link, BluntLink):
            record["blunt"] = 1.0
            record["turn"] = np.eye(3).ravel()
            record["matrix"] = link.matrix(density).ravel()
            record["area"], record["turning"] = link.areas, link.turnings
            record["volume"] = link.displaced
            record["center"] = link.buoyancy_center or link.origin
            continue
        integrals = outline(link.outline, density, link.start, link.start + link.length)
        for field in SPATIAL.names or ():
            if hasattr(integrals, field):
                record[field] = getattr(integrals, field)
        record["length"] = link.length
        record["turn"] = link.frame.ravel()
        record["matrix"] = _matrix(integrals).ravel()
        if link.volume is not None:
            record["volume"] = link.volume
        record["center"] = link.buoyancy_center or link.origin + integrals.centroid * link.frame[0]
    _fill_coefficients(filled, links)
    return filled


def _matrix(integrals: LinkOutline) -> FloatArray:
    """Return the added mass (6, 6) of strips about their origin, for c_m = 1, as `added_momentum` has it."""
    y, z = integrals.added, integrals.added_width
    matrix = np.diag([0.0, y[0], z[0], integrals.added_roll, z[2], y[2]])
    matrix[1, 5] = matrix[5, 1] = y[1]
    matrix[2, 4] = matrix[4, 2] = -z[1]
    return matrix


def _fill_coefficients(filled: RecordArray, links: Sequence[Link]) -> None:
    """Fill the coefficients of links into their `SPATIAL` or `LINK` records."""
    for record, link in zip(filled, links, strict=True):
        record["c_m"] = link.c_m
        record["munk"] = link.munk_moment
        if isinstance(link, BluntLink):
            record["c_d"] = link.c_d
            continue
        record["c_d"] = link.drag_coefficient
        record["c_f"] = link.c_f
        if "roll_damping" in (filled.dtype.names or ()):
            record["roll_damping"] = link.roll_damping


def plane_records(model: mujoco.MjModel, links: Sequence[StripLink], density: float) -> RecordArray:
    """Return one `LINK` record a link: what a load sees of it, which knows the plane of the link's x and y only.

    Mass, centre and inertia are those of the entire body; the last of the links is the fish's last.
    """
    filled = np.zeros(len(links), dtype=LINK)
    for record, spatial, link in zip(filled, records(links, density), links, strict=True):
        integrals = outline(link.outline, density, link.start, link.start + link.length)
        for field in {*(LINK.names or ())} & {*(SPATIAL.names or ())}:
            record[field] = spatial[field]
        for field in ("strip_perimeter", "coarse_r", "coarse_weight", "coarse_height"):
            record[field] = getattr(integrals, field)
        body = model.body(link.body)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        record["mass"] = body.mass[0]
        record["com"] = link.frame[0] @ (body.ipos - np.array(link.origin))
        record["inertia"] = (link.frame[2] @ turn.reshape(3, 3)) ** 2 @ body.inertia
    filled["first"][:1] = filled["last"][-1:] = 1.0
    return filled


def carriers(model: mujoco.MjModel, bodies: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of carriers (c, CARRIER) and trees (t, TREE): all bodies of the trees in which `bodies` hang."""
    roots = np.unique(model.body_rootid[list(bodies)])
    ids = np.flatnonzero(np.isin(model.body_rootid, roots) & (np.arange(model.nbody) > 0))
    row_of = {int(body): row for row, body in enumerate(ids)}
    parents = [row_of.get(int(parent), -1) for parent in model.body_parentid[ids]]
    rows = np.column_stack([ids, parents, model.body_dofadr[ids], model.body_dofnum[ids]]).astype(np.float64)
    moving = (ids[(model.body_rootid[ids] == root) & (model.body_dofnum[ids] > 0)] for root in roots)
    # The dofs of a tree are contiguous.
    trees = [(model.body_dofadr[own].min(), model.body_dofnum[own].sum()) for own in moving if len(own)]
    return rows, np.array(trees, dtype=np.float64).reshape(-1, TREE)


class Water(NamedTuple):
    """What compiled code reads of a block: views of its memory.

    Attributes:
        head: (1,) of `HEADER`.
        carriers, trees, links, loads, planes: as in `Block`.
    """

    head: Any
    carriers: Any
    trees: Any
    links: Any
    loads: LoadTable
    planes: Any


_header_at, _spatial_at, _plane_at = (pointer_to(from_dtype(kind)) for kind in (HEADER, SPATIAL, LINK))


@compiled
def view(address: int) -> Water:
    """Return the views of the block at an address."""
    header = carray(_header_at(address), 1)
    head = header[0]
    return Water(
        header,
        carray(floats(head.carriers_at), (head.carriers, CARRIER)),
        carray(floats(head.trees_at), (head.trees, TREE)),
        carray(_spatial_at(head.links_at), head.links),
        LoadTable(carray(counts(head.addresses_at), head.addresses), carray(floats(head.rows_at), (head.rows, ROW))),
        carray(_plane_at(head.planes_at), head.planes),
    )
