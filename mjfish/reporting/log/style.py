"""Colours and the scale of arrows: the same in every view of a log."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mjfish.reporting.log.scene import Run, Swimmer

#: Red, green, blue, alpha of each swimmer, bodies and curves alike.
COLOURS: dict[Swimmer, tuple[int, int, int, int]] = {
    "measured": (205, 208, 214, 255),
    "nominal": (229, 138, 60, 150),
    "extended": (46, 168, 178, 200),
    "simulated": (46, 168, 178, 200),
}
#: Kinds of force, as they are called in the log and in `mjfish.ode.forces.LinkForces`.
FORCES = {"drag": (232, 84, 100, 255), "added_mass": (136, 150, 255, 255), "load": (226, 204, 70, 255)}
FLOOR = (70, 78, 90, 255)
#: At three instants of four no arrow is longer than this share of the fish.
_REACH = 0.5


def arrow_scale(runs: Iterable[Run]) -> float:
    """Return the length of an arrow of 1 N [m/N], one for all runs, rounded to one digit."""
    largest, length = [np.zeros(1)], 1.0
    for run in runs:
        length = run.fish.length
        for swim in run.swims:
            if swim.forces is not None:
                every = np.stack([getattr(swim.forces, kind) for kind in FORCES])
                largest.append(np.linalg.norm(every[..., :2], axis=3).max(axis=(0, 2)))
    typical = float(np.quantile(np.concatenate(largest), 0.75))
    return float(f"{_REACH * length / typical:.0e}") if typical > 0.0 else 1.0
