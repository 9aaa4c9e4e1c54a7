"""Force noise on the swimmer that no model of the list explains: eddies, or a slow drift."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np
from scipy.signal import lfilter

from studies.battery.generator.draft import Draft
from studies.battery.generator.world import Disturbance

Kind = Literal["none", "forces", "drift"]
#: Memory of the forces [s]: eddies, drift.
_MEMORY = {"forces": (0.1, 0.6), "drift": (3.0, 10.0)}
_EVERY = 0.02
#: Forces in these proportions: F_x, F_y [N], M_z [N m].
_SHAPE = np.array([1.0, 2.0, 0.2])


def draw(made: Draft, kind: Kind | None, level: float) -> tuple[tuple[Disturbance | None, ...], Mapping[str, Any]]:
    """Draw Ornstein-Uhlenbeck forces for every run, such that the velocities move by `level` sigmas of the camera, rms.

    Returns:
        One disturbance a run (None: none), and what the truth says of it.
    """
    rng = made.rng
    if kind is None:
        kind = get_args(Kind)[int(rng.choice(3, p=[0.5, 0.3, 0.2]))]
    if kind == "none":
        return (None,) * len(made.plan.runs), {}
    memory = float(rng.uniform(*_MEMORY[kind]))
    size = 0.002
    a = np.exp(-_EVERY / memory)
    kicks = []
    for number in range(len(made.plan.runs)):
        white = rng.standard_normal((int(made.plan.runs[number].duration / _EVERY) + 40, 3))
        white[1:] *= np.sqrt(1.0 - a * a)
        kicks.append(_SHAPE * lfilter([1.0], [1.0, -a], white, axis=0))
    for _ in range(2):  # the response is nearly linear in the forces
        moved = []
        for number, kick in enumerate(kicks):
            pushed = made.clean(number, {}, disturbance=Disturbance(_EVERY, size * kick))
            moved.append((pushed - made.clean(number, {})) / np.array(made.noise.sigma))
        size *= level / float(np.sqrt(np.mean(np.concatenate(moved) ** 2)))
    told = {"kind": kind, "memory": memory, "level": level, "force": [float(f) for f in size * _SHAPE]}
    return tuple(Disturbance(_EVERY, size * kick) for kick in kicks), told
