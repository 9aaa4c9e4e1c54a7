"""Rollouts with their derivatives in many directions, exact, in one pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.link import link_records
from mjfish.hydro.load import Load, load_rows, memory_of
from mjfish.ode.equation import STATES
from mjfish.ode.integrate_along import integrate_along, scratch
from mjfish.ode.lanes import Direction, changes_of, jumps_of, longer_of, moving_of, probes_of
from mjfish.ode.rollout import TO_FORWARD, Coriolis, Rollout, place_in, start_of, tail_of

#: Lanes come in multiples of what a vector register holds.
_WIDTH = 4


def simulate_along(
    fish: Fish,
    motion: JointMotion,
    directions: Sequence[Direction],
    time: FloatArray,
    *,
    values: Mapping[str, float] | None = None,
    velocity: FloatArray | None = None,
    pose: FloatArray | None = None,
    coriolis: Coriolis = "corrected",
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
    silent: Sequence[tuple[Load, Sequence[float]]] = (),
) -> tuple[Rollout, FloatArray]:
    """Simulate like `mjfish.ode.simulate`, and along with it the derivatives in all `directions`.

    Args:
        fish, motion, values, velocity, pose, coriolis, loads: as in `simulate`.
        directions: k of them.
        time: (m,) at which derivatives are asked for [s].
        silent: loads with parameters at which they exert nothing, but would along a direction.

    Returns:
        The rollout, that of `simulate` to the last bit, and the derivatives of its state (m, 8, k); NaN after the end.
    """
    bent_first = sorted(range(len(directions)), key=lambda k: directions[k].motion is None)
    ordered = [directions[k] for k in bent_first]
    records, links = link_records(fish, values), len(fish.links)
    # Special loads go along even where they exert nothing: what they remember, or where they are, must be known.
    hushed = sorted(range(len(silent)), key=lambda k: not silent[k][0].special)
    every = [*loads, *(silent[k] for k in hushed)]
    acting = len(loads) + sum(one.special for one, _ in silent)
    row_of = [*range(len(loads)), *(len(loads) + hushed.index(k) for k in range(len(silent)))]
    start = start_of(velocity, pose, memory_of(every[:acting], links))
    addresses, rows = load_rows(every, links, STATES, [one for one, _ in silent])
    width = -(-len(ordered) // _WIDTH) * _WIDTH
    lanes, slack = np.zeros((len(start), width)), np.zeros((3, width))
    for k, one in enumerate(ordered):
        if one.velocity is not None:
            lanes[:STATES, k] = start_of(one.velocity)
        if one.tail is not None:
            slack[:, k] = one.tail
    moving = moving_of(ordered, motion)
    steps = len(motion.time) - 1
    states, rates = np.zeros((steps, 2, len(start))), np.zeros((steps, 2, len(start)))
    index, at = place_in(motion.time, time)
    order = np.argsort(index, kind="stable")
    read = np.full((len(time), STATES, width), np.nan)
    special = any(one.special for one, _ in loads)
    run: Any = integrate_along
    done = run(
        records, motion.time, *motion.trigonometry, motion.rate, motion.acceleration,
        np.ascontiguousarray(motion.angle[:, :, -1]), jumps_of(motion, moving), start, tail_of(fish),
        coriolis == "printed", addresses[:acting], rows, lanes, slack, moving,
        *changes_of(ordered, records, loads), *probes_of(ordered, addresses, rows, row_of, len(loads)),
        index[order], at[order],
        *scratch(
            motion.joints, width, moving.shape[3], len(start), longer_of(ordered, links, width) if special else None
        ),
        states, rates, read,
    )  # fmt: skip
    along = np.empty((len(time), STATES, len(ordered)))
    along[order[:, None], :, np.array(bent_first, dtype=np.int64)] = np.moveaxis(read, 1, 2)[:, : len(ordered)]
    along[time > motion.time[-1] + 1e-9] = np.nan
    along *= TO_FORWARD[:, None]
    return Rollout.of(motion, states, rates, done), along
