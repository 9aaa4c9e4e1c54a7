"""The equation of motion linearised along a rollout: how a small deviation of the velocity grows or dies.

    dv' = A(t) dv,   A = d(u', v', w') / d(u, v, w)

exact, by the complex step (`mjfish.hydro.load_tangent`); pose and tail deflection are held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.fish import Fish
from mjfish.hydro.link import COMPLEX_LINK, LINK, link_records
from mjfish.hydro.load import Load, load_table
from mjfish.hydro.load_tangent import TINY
from mjfish.ode.equation import STATES, derivative
from mjfish.ode.rollout import Rollout, tail_of


def growth(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> FloatArray:
    """Return A (n, 3, 3) [1/s; yaw in rad] at the start of every step of a rollout, in the forward frame.

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
    """
    motion, steps = rollout.motion, len(rollout.state)
    state = rollout.state[:, 0].copy()
    state[:, :3], state[:, 3:6] = frames.flip(state[:, :3]), frames.flip(state[:, 3:6])
    numbers = link_records(fish, values).view(np.float64).reshape(-1, LINK.itemsize // 8)
    addresses, parameters = load_table(loads)
    along: Any = parameters.astype(np.complex128)
    out = np.zeros((steps, 3, 3))
    cos, sin = motion.trigonometry
    run: Any = _growth
    run(
        np.ascontiguousarray(numbers.astype(np.complex128)).view(COMPLEX_LINK).ravel(),
        cos[:steps, 0].astype(np.complex128), sin[:steps, 0].astype(np.complex128),
        motion.rate[:steps, 0].astype(np.complex128), motion.acceleration[:steps, 0].astype(np.complex128),
        motion.angle[:steps, 0, -1].astype(np.complex128), state.astype(np.complex128),
        tail_of(fish).astype(np.complex128), addresses, along, out,
    )  # fmt: skip
    signs = frames.flip(np.ones(3))
    return np.asarray(signs[:, None] * out * signs)


@compiled
def _growth(
    links: Any,
    cos: Any,
    sin: Any,
    rate: Any,
    acceleration: Any,
    last: Any,
    state: Any,
    tail: Any,
    hooks: Any,
    hook_parameters: Any,
    out: FloatArray,
) -> None:
    scratch = np.zeros(3)
    moved: Any = np.empty(STATES, dtype=np.complex128)
    for k in range(out.shape[0]):
        for j in range(3):
            trial = state[k].copy()
            trial[j] += complex(0.0, TINY)
            derivative(
                links, cos[k], sin[k], rate[k], acceleration[k], last[k], trial, tail, False, hooks,
                hook_parameters, scratch, moved,
            )  # fmt: skip
            for i in range(3):
                out[k, i, j] = moved[i].imag / TINY
