"""Directions in which a rollout is derived, and the arrays of lanes that compiled code makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.hydro.link import LINK, NUMBERS, column
from mjfish.hydro.load import AT_SPECIAL, PARAMETERS, ROW, Load
from mjfish.hydro.load_slopes import REACH, REACH_SILENT
from mjfish.hydro.outline import INTERVALS
from mjfish.ode.along import CHANGE, LANE, MOVED, OUTLINE
from mjfish.ode.along import LINK as AT_LINK
from mjfish.ode.along import REACH as REACH_OF

_TABLES = slice(column("node_height"), column("strip_r"))
#: Rate of a jump of a lane's joint rates that counts as one, relative to its largest rate: rounding does not.
_JUMP = 1e-7


@dataclass(frozen=True, eq=False)
class Direction:
    """What a rollout is derived by: rates of change of its inputs; None is zero.

    Attributes:
        links: (links, numbers of `LINK`) of the link records.
        tail: (3,) of the flexible tail, see `mjfish.ode.equation`.
        velocity: (3,) of the velocity at the start, in the forward frame.
        motion: (3, n, 3, joints) of angle, rate and acceleration of the joints.
        loads: (k, PARAMETERS) of the parameters of the loads, those that act and then the silent ones.
    """

    links: FloatArray | None = None
    tail: FloatArray | None = None
    velocity: FloatArray | None = None
    motion: FloatArray | None = None
    loads: FloatArray | None = None


def changes_of(directions: Sequence[Direction], records: Any, loads: Sequence[tuple[Load, Sequence[float]]]) -> Any:
    """Return what the lanes change of the links, for `mjfish.ode.along`: pairs of lane and link that change.

    Returns:
        Numbers of each pair (p, CHANGE); rates of the outlines that change, height and its moments (g, INTERVALS + 1,
        5); and records (2 r,) moved to both sides, for loads.
    """
    held = [(lane, one.links) for lane, one in enumerate(directions) if one.links is not None]
    rows = np.array([links for _, links in held]).reshape(len(held), len(records), NUMBERS)
    which, link = np.nonzero(rows.any(axis=2))
    rate = rows[which, link]
    here = records.view(np.float64).reshape(-1, NUMBERS)[link]
    shaped = rate[:, _TABLES].any(axis=1) | (rate[:, column("length")] != 0.0)
    tables = rate[shaped, _TABLES]
    height, moments = tables[:, : INTERVALS + 1], tables[:, INTERVALS + 1 :].reshape(-1, INTERVALS + 1, 4)
    changes = np.empty((len(rate), CHANGE))
    changes[:, :LANE] = _amounts(here, rate)
    changes[:, LANE] = np.array([lane for lane, _ in held], dtype=np.int64)[which]
    changes[:, AT_LINK] = link
    changes[:, OUTLINE] = _numbered(shaped)
    changes[:, MOVED], moved, changes[:, REACH_OF] = _moved(here, rate, loads)
    return changes, np.concatenate([height[:, :, None], moments], axis=2), moved


def _numbered(chosen: Any) -> Any:
    """Return 0, 1, 2, ... where chosen, else -1."""
    return np.where(chosen, np.cumsum(chosen) - 1, -1)


def _amounts(here: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the rates of what the wrench of a link is linear in (p, LANE), by the product rule."""
    names = ("mass", "com", "inertia", "density", "c_m", "c_d", "c_f", "munk", "wetted", "length")
    mass, com, _, density, c_m, c_d, c_f, _, wetted, _ = (here[:, column(name)] for name in names)
    d = {name: rate[:, column(name)] for name in names}
    added = slice(column("added"), column("added") + 3)
    a0, a1, a2 = (d["c_m"] * here[:, added].T) + c_m * rate[:, added].T
    first = d["mass"] * com + mass * d["com"]
    return np.stack([
        d["mass"], first, a0, a1,
        d["inertia"] + first * com + mass * com * d["com"] + a2,
        d["munk"],
        0.5 * (d["density"] * c_f * wetted + density * d["c_f"] * wetted + density * c_f * d["wetted"]),
        0.5 * (d["density"] * c_d + density * d["c_d"]),
        d["length"],
    ], axis=1)  # fmt: skip


def _moved(here: FloatArray, rate: FloatArray, loads: Sequence[tuple[Load, Sequence[float]]]) -> tuple[Any, Any, Any]:
    """Return the records moved along their change, where a load may see it: index (p,), records (2 r,), reach (p,)."""
    read = np.zeros(NUMBERS, dtype=bool)
    for one, _ in loads:
        read |= one.reads
    seen = rate * read
    touched = seen.any(axis=1)
    with np.errstate(divide="ignore"):
        reach = REACH * np.min(np.maximum(np.abs(here), 1e-3) / np.abs(seen), axis=1, initial=np.inf)
    reach = np.where(touched, reach, 0.0)
    sides = here[touched, None] + reach[touched, None, None] * np.array([[[1.0], [-1.0]]]) * seen[touched, None]
    return _numbered(touched), np.ascontiguousarray(sides).reshape(-1).view(LINK), reach


def probes_of(
    directions: Sequence[Direction], addresses: Any, rows: FloatArray, row_of: Sequence[int], acting: int
) -> tuple[FloatArray, Any]:
    """Return what the lanes change of the loads' parameters.

    Args:
        directions: of the lanes.
        addresses, rows: (k,), (k, ROW) of all loads, `mjfish.hydro.load.load_rows`.
        row_of: (k,) row in this table of each load of a direction.
        acting: how many of the rows exert something; the others are silent.

    Returns:
        Rows moved to both sides, with lane, and how far they are moved (2 q, ROW + 2); addresses (q,).
    """
    probes, which = [], []
    held = [(lane, one.loads) for lane, one in enumerate(directions) if one.loads is not None]
    for lane, rates in held:
        for k in np.flatnonzero(rates.any(axis=1)):
            row, rate = row_of[int(k)], np.concatenate([rates[k], np.zeros(ROW - PARAMETERS)])
            hit = rate != 0.0
            share = REACH if row < acting else REACH_SILENT
            reach = share * float(np.min(np.maximum(np.abs(rows[row, hit]), 0.1) / np.abs(rate[hit])))
            told = reach if row < acting else -reach
            probes += [[*(rows[row] + side * reach * rate), lane, told] for side in (1.0, -1.0)]
            which.append(row)
    made = np.array(probes).reshape(-1, ROW + 2)
    made[:, AT_SPECIAL] = 0.0  # asked for here, whatever else it does
    return made, addresses[np.array(which, dtype=np.int64)]


def longer_of(directions: Sequence[Direction], links: int, width: int) -> FloatArray:
    """Return the rates (links, width) of the lengths of the links."""
    longer = np.zeros((links, width))
    for lane, one in enumerate(directions):
        if one.links is not None:
            longer[:, lane] = one.links[:, column("length")]
    return longer


def moving_of(directions: Sequence[Direction], motion: JointMotion) -> FloatArray:
    """Return the rates (n, 3, 3 joints, b) of angles, rates, accelerations of the joints of the lanes that have any."""
    held = [one.motion for one in directions if one.motion is not None]
    steps, joints = len(motion.time) - 1, motion.joints
    moving = np.empty((steps, 3, 3 * joints, len(held)))
    for b, rate in enumerate(held):
        for kind in range(3):
            moving[:, :, kind * joints : (kind + 1) * joints, b] = rate[kind]
    return moving


def jumps_of(motion: JointMotion, moving: FloatArray) -> BoolArray:
    """Return (n,) whether the rates of motion or lanes jump before each step."""
    jumps = np.zeros(len(motion.time) - 1, dtype=bool)
    jumps[1:] = (np.abs(motion.rate[1:, 0] - motion.rate[:-1, 2]) > 1e-9).any(axis=1)
    if moving.shape[3]:
        rates = moving[:, :, motion.joints : 2 * motion.joints]
        bound = _JUMP * np.abs(rates[:, 0]).max(axis=(0, 1))
        jumps[1:] |= (np.abs(rates[1:, 0] - rates[:-1, 2]) > bound).any(axis=(1, 2))
    return jumps
