"""Layout of the numbers of one model's water, all float64, that compiled code reads: see `mjfish.mujoco.blocks`.

HEADER numbers; then a row of CARRIER numbers for every body of the trees that water acts on, parents first; then a row
of TREE numbers for every such tree; then one `SPATIAL` record a link; then, where there are loads
(`mjfish.hydro.load`), their addresses (unsigned integers), a row of PARAMETERS numbers each, and one `LINK` record a
link, for them to read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from mjfish.arrays import FloatArray, RecordArray
from mjfish.hydro.link import LINK
from mjfish.hydro.load import PARAMETERS, Load, load_table
from mjfish.hydro.outline import outline
from mjfish.hydro.spatial_link import SPATIAL
from mjfish.mujoco.strip_link import StripLink

#: Number of links, carriers and trees; 1 for the coupling "inertia"; 1 where userdata holds the servo commands; number
#: of bodies and dofs of the model, by which a tag on another model is seen; number of loads.
HEADER = 8
#: Id of the body, row of its parent or -1, first dof, number of dofs.
CARRIER = 4
#: First dof, number of dofs.
TREE = 2
#: Bytes of a link's record.
SPATIAL_SIZE = SPATIAL.itemsize


def records(links: Sequence[StripLink], density: float) -> RecordArray:
    """Return one `SPATIAL` record a link; the ids of bodies are not in it yet."""
    made = np.zeros(len(links), dtype=SPATIAL)
    for record, link in zip(made, links, strict=True):
        integrals = outline(link.outline, density, link.start, link.start + link.length)
        for field in SPATIAL.names or ():
            if hasattr(integrals, field):
                record[field] = getattr(integrals, field)
        for field in ("length", "c_m", "c_d", "c_f", "roll_damping", "origin"):
            record[field] = getattr(link, field)
        record["munk"] = link.munk_moment
        record["density"] = density
        record["turn"] = link.frame.ravel()
        if link.volume is not None:
            record["volume"] = link.volume
        middle = np.array(link.origin) + integrals.centroid * link.frame[0]
        record["center"] = middle if link.buoyancy_center is None else link.buoyancy_center
    return made


def plane_records(model: mujoco.MjModel, links: Sequence[StripLink], density: float) -> RecordArray:
    """Return one `LINK` record a link: how it looks to a load, which knows the plane of the link's x and y only.

    Mass, centre and inertia are those of the whole body; the last of the links is the fish's last.
    """
    made = np.zeros(len(links), dtype=LINK)
    for record, spatial, link in zip(made, records(links, density), links, strict=True):
        integrals = outline(link.outline, density, link.start, link.start + link.length)
        for field in LINK.names or ():
            if field in (SPATIAL.names or ()):
                record[field] = spatial[field]
        record["strip_perimeter"] = integrals.strip_perimeter
        body = model.body(link.body)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        record["mass"] = body.mass[0]
        record["com"] = link.frame[0] @ (body.ipos - np.array(link.origin))
        record["inertia"] = (link.frame[2] @ turn.reshape(3, 3)) ** 2 @ body.inertia
    made[-1]["last"] = 1.0
    return made


def carriers(model: mujoco.MjModel, bodies: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of carriers (c, CARRIER) and trees (t, TREE): the trees, whole, in which `bodies` hang."""
    roots = np.unique(model.body_rootid[list(bodies)])
    ids = np.flatnonzero(np.isin(model.body_rootid, roots) & (np.arange(model.nbody) > 0))
    row_of = {int(body): row for row, body in enumerate(ids)}
    rows = [
        (body, row_of.get(int(model.body_parentid[body]), -1), model.body_dofadr[body], model.body_dofnum[body])
        for body in ids
    ]
    trees = [_dofs(model, ids[model.body_rootid[ids] == root]) for root in roots]
    moving = [tree for tree in trees if tree[1] > 0]
    return np.array(rows, dtype=np.float64), np.array(moving, dtype=np.float64).reshape(-1, TREE)


def _dofs(model: mujoco.MjModel, bodies: FloatArray) -> tuple[int, int]:
    """Return first dof and number of dofs of a tree; they are contiguous."""
    first = [int(model.body_dofadr[body]) for body in bodies if model.body_dofnum[body]]
    return (min(first) if first else 0), int(model.body_dofnum[bodies].sum())


def pack(
    model: mujoco.MjModel,
    links: Sequence[StripLink],
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
        inertia: coupling of the added mass: in the inertia, or in the forces.
        commanded: userdata holds the servo commands of each step.
        loads: extra forces on every link, with their parameters.
    """
    bodies = [model.body(link.body).id for link in links]
    rows, trees = carriers(model, bodies)
    water = records(links, density)
    water["body"] = bodies
    water["carrier"] = np.searchsorted(rows[:, 0], bodies)
    header = [len(links), len(rows), len(trees), float(inertia), float(commanded), model.nbody, model.nv, len(loads)]
    parts: list[FloatArray] = [np.array(header), rows.ravel(), trees.ravel(), water.view(np.float64).ravel()]
    if loads:
        addresses, parameters = load_table(loads)
        seen = plane_records(model, links, density)
        parts += [addresses.view(np.float64), parameters.ravel(), seen.view(np.float64).ravel()]
    return np.concatenate(parts)


def unpack(numbers: FloatArray) -> RecordArray:
    """Return the `SPATIAL` records in the numbers of a model's water, a view."""
    n, c, t = (int(count) for count in numbers[:3])
    start = HEADER + CARRIER * c + TREE * t
    return numbers[start : start + n * SPATIAL_SIZE // 8].view(SPATIAL)


def loads_in(numbers: FloatArray) -> tuple[Any, FloatArray, RecordArray]:
    """Return addresses (k,) and parameters (k, PARAMETERS) of the loads, and `LINK` records, none without loads."""
    n, c, t = (int(count) for count in numbers[:3])
    k = int(numbers[7])
    rest = numbers[HEADER + CARRIER * c + TREE * t + n * SPATIAL_SIZE // 8 :]
    parameters = rest[k : k + k * PARAMETERS].reshape(k, PARAMETERS)
    return rest[:k].view(np.uint64), parameters, rest[k + k * PARAMETERS :].view(LINK)
