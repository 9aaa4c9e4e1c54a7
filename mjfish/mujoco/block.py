"""The numbers that describe a model's water: one block of memory a model, which compiled code finds from the model.

MuJoCo's control callback is given a model and its data and nothing else; models are copied (by `copy.copy`, by
`mujoco.batch`), and several are stepped at once. So a model carries a tag: MuJoCo's override of contact parameters,
`opt.o_solimp`, is five numbers that nothing reads while contacts are not overridden, and that every copy keeps. The
tag leads to a row of a table, the row to a block of numbers. A tag whose block is gone, or of another process, leads
nowhere, and the callback then spoils the step visibly instead of leaving the model dry.

A block holds, all as float64: HEADER numbers; a row of CARRIER numbers for every body of the trees that water acts on,
parents first; a row of TREE numbers for every such tree; a `SPATIAL` record for every link; and, where there are loads
(`mjfish.hydro.load`), their addresses (unsigned integers), a row of ROW numbers each, and a `LINK` record for every
link, for them to read. `pack` writes it, `view` reads it in compiled code.
"""

from __future__ import annotations

import secrets
import threading
import weakref
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import carray

from mjfish.errors import InputError, MjfishError
from mjfish.fish.outline import outline
from mjfish.hydro.link import LINK, SPATIAL
from mjfish.hydro.load import ROW, Load, LoadTable, load_rows, memory_of
from mjfish.mujoco.blunt_link import BluntLink
from mjfish.mujoco.layout import counts, floats, plane_links, spatial_links
from mjfish.mujoco.links import Link
from mjfish.mujoco.memory import room_in
from mjfish.mujoco.strip_link import StripLink
from mjfish.numerics.arrays import FloatArray, RecordArray
from mjfish.numerics.compiled import compiled

#: Number of links, carriers and trees; 1 for the coupling "inertia"; 1 where userdata holds the servo commands; number
#: of bodies, dofs, actuators and activations of the model, by which a tag on another model is seen; number of loads;
#: 1 where one of them reads the place of its link; then `mjfish.mujoco.memory.Room`.
HEADER = 14
#: Id of the body, row of its parent or -1, first dof, number of dofs.
CARRIER = 4
#: First dof, number of dofs.
TREE = 2
_SPATIAL_SIZE = SPATIAL.itemsize

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
    """The numbers of one model's water, at an address that stays; its row of the table is freed with it."""

    def __init__(self, numbers: FloatArray, loads: Sequence[Load] = ()) -> None:
        """Give the numbers a row.

        Args:
            numbers: (k,) of float64; from now on the block's own.
            loads: live as long as the block, whose numbers hold their addresses.

        Raises:
            MjfishError: the table is full.
        """
        self.numbers = numbers
        self._loads = tuple(loads)
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


def numbers_of(model: mujoco.MjModel) -> FloatArray:
    """Return the numbers of the water that a model is tagged with.

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
    return block.numbers


def _release(row: int) -> None:
    TABLE[row, 0] = 0
    with _lock:
        _free.append(row)


def pack(
    model: mujoco.MjModel,
    links: Sequence[Link],
    density: float,
    *,
    inertia: bool,
    commanded: bool,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> FloatArray:
    """Return the numbers of the water on `links` of `model`; every body must be in it.

    Args:
        model: the model.
        links: the links.
        density: of the water [kg/m3].
        inertia: whether the coupling is "inertia", else "xfrc" (`mjfish.mujoco.coupling`).
        commanded: whether userdata holds the servo commands of each step.
        loads: extra forces on every link, with their parameters.
    """
    bodies = [model.body(link.body).id for link in links]
    rows, trees = carriers(model, bodies)
    water = records(links, density)
    water["body"] = bodies
    water["carrier"] = np.searchsorted(rows[:, 0], bodies)
    header = [len(links), len(rows), len(trees), float(inertia), float(commanded)]
    header += [model.nbody, model.nv, model.nu, model.na, len(loads), float(any(load.placed for load, _ in loads))]
    header += room_in(model, memory_of(loads, len(links)))
    parts: list[FloatArray] = [np.array(header), rows.ravel(), trees.ravel(), water.view(np.float64).ravel()]
    if loads:
        table = load_rows(loads, len(links))
        seen = plane_records(model, [link for link in links if isinstance(link, StripLink)], density)
        parts += [table.addresses.view(np.float64), table.rows.ravel(), seen.view(np.float64).ravel()]
    return np.concatenate(parts)


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
            record["center"] = link.origin if link.buoyancy_center is None else link.buoyancy_center
            continue
        integrals = outline(link.outline, density, link.start, link.start + link.length)
        for field in SPATIAL.names or ():
            if hasattr(integrals, field):
                record[field] = getattr(integrals, field)
        record["length"] = link.length
        record["turn"] = link.frame.ravel()
        if link.volume is not None:
            record["volume"] = link.volume
        middle = np.array(link.origin) + integrals.centroid * link.frame[0]
        record["center"] = middle if link.buoyancy_center is None else link.buoyancy_center
    _fill_coefficients(filled, links)
    return filled


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
        for field in LINK.names or ():
            if field in (SPATIAL.names or ()):
                record[field] = spatial[field]
        record["strip_perimeter"] = integrals.strip_perimeter
        for field in ("coarse_r", "coarse_weight", "coarse_height"):
            record[field] = getattr(integrals, field)
        body = model.body(link.body)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        record["mass"] = body.mass[0]
        record["com"] = link.frame[0] @ (body.ipos - np.array(link.origin))
        record["inertia"] = (link.frame[2] @ turn.reshape(3, 3)) ** 2 @ body.inertia
    filled[0]["first"] = filled[-1]["last"] = 1.0
    return filled


def carriers(model: mujoco.MjModel, bodies: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of carriers (c, CARRIER) and trees (t, TREE): all bodies of the trees in which `bodies` hang."""
    roots = np.unique(model.body_rootid[list(bodies)])
    ids = np.flatnonzero(np.isin(model.body_rootid, roots) & (np.arange(model.nbody) > 0))
    row_of = {int(body): row for row, body in enumerate(ids)}
    rows = [
        (body, row_of.get(int(model.body_parentid[body]), -1), model.body_dofadr[body], model.body_dofnum[body])
        for body in ids
    ]
    trees = []
    for root in roots:
        moving = ids[(model.body_rootid[ids] == root) & (model.body_dofnum[ids] > 0)]
        if len(moving):  # the dofs of a tree are contiguous
            trees.append((model.body_dofadr[moving].min(), model.body_dofnum[moving].sum()))
    return np.array(rows, dtype=np.float64), np.array(trees, dtype=np.float64).reshape(-1, TREE)


def unpack(numbers: FloatArray) -> RecordArray:
    """Return the `SPATIAL` records in the numbers of a model's water, a view."""
    n, c, t = (int(count) for count in numbers[:3])
    start = HEADER + CARRIER * c + TREE * t
    return numbers[start : start + n * _SPATIAL_SIZE // 8].view(SPATIAL)


def replace_coefficients(numbers: FloatArray, links: Sequence[Link]) -> None:
    """Write the coefficients of `links` into the numbers of a model's water; all else of them must be as it was."""
    _fill_coefficients(unpack(numbers), links)
    seen = loads_in(numbers)[1]
    if len(seen):
        _fill_coefficients(seen, links)


def loads_in(numbers: FloatArray) -> tuple[LoadTable, RecordArray]:
    """Return the loads, and `LINK` records, none without loads."""
    n, c, t = (int(count) for count in numbers[:3])
    k = int(numbers[9])
    rest = numbers[HEADER + CARRIER * c + TREE * t + n * _SPATIAL_SIZE // 8 :]
    rows = rest[k : k + k * ROW].reshape(k, ROW)
    return LoadTable(rest[:k].view(np.uint64), rows), rest[k + k * ROW :].view(LINK)


class Water(NamedTuple):
    """What compiled code reads of a block: views of its memory.

    Attributes:
        inertia: whether the coupling is "inertia", else "xfrc".
        commanded: whether userdata holds the servo commands.
        bodies, dofs, actuators, activations: of the model that the block was made for.
        carriers: (c, CARRIER).
        trees: (t, TREE).
        links: (n,) of `SPATIAL`.
        loads: k of them.
        placed: whether one of them reads the place of its link.
        states, control, activation: of `mjfish.mujoco.memory.Room`.
        planes: (n,) of `LINK`; meaningless where k is 0.
    """

    inertia: Any
    commanded: Any
    bodies: Any
    dofs: Any
    actuators: Any
    activations: Any
    carriers: Any
    trees: Any
    links: Any
    loads: LoadTable
    placed: Any
    states: Any
    control: Any
    activation: Any
    planes: Any


@compiled
def view(address: int) -> Water:
    """Return the views of the block at an address."""
    header = carray(floats(address), HEADER)
    n, c, t, k = int(header[0]), int(header[1]), int(header[2]), int(header[9])
    at_trees = address + 8 * (HEADER + CARRIER * c)
    at_links = at_trees + 8 * TREE * t
    at_loads = at_links + _SPATIAL_SIZE * n
    at_rows = at_loads + 8 * k
    return Water(
        header[3] > 0.0,
        header[4] > 0.0,
        int(header[5]),
        int(header[6]),
        int(header[7]),
        int(header[8]),
        carray(floats(address + 8 * HEADER), (c, CARRIER)),
        carray(floats(at_trees), (t, TREE)),
        carray(spatial_links(at_links), n),
        LoadTable(carray(counts(at_loads), k), carray(floats(at_rows), (k, ROW))),
        header[10] > 0.0,
        int(header[11]),
        int(header[12]),
        int(header[13]),
        carray(plane_links(at_rows + 8 * ROW * k), n),
    )
