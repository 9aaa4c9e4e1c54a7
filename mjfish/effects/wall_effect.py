"""Walls of the tank: drag grows near them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.effects.place import unplaced
from mjfish.hydro.force import crossflow
from mjfish.hydro.load import load
from mjfish.parameters import Parameter

#: Lengths of decay within which a wall matters at all: beyond, less than a twentieth of it is left.
_NEAR = 3.0


@load
def _more(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return size exp(-d / reach) of the link's drag, at the distance d of its middle from the nearest wall."""
    half = 0.5 * link.length
    x = link.x - half * np.cos(link.heading)
    y = link.y - half * np.sin(link.heading)
    distance = min(min(x - parameters[2], parameters[3] - x), min(y - parameters[4], parameters[5] - y))
    factor = -0.5 * link.density * parameters[0] * np.exp(-max(distance, 0.0) / parameters[1])
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    along = link.c_f * link.wetted * abs(link.u) * link.u
    return factor * along, factor * link.c_d * force, factor * link.c_d * moment


class WallEffect(Effect):
    """Friction and drag across of each link are (1 + psi exp(-d / l)) times as large at a distance d from a wall.

    The flow around the body has to pass between body and wall, and is faster there: with the blockage grows the drag
    (blockage corrections of towing tanks). psi is the increase at the wall itself, l how far it reaches; the distance
    is that of the middle of the link to the nearest of the four walls of the tank.
    """

    name, domain, mechanism = "wall_effect", "water", "walls"
    summary = "drag grows near the walls of the tank"
    parameters = (
        Parameter("wall_effect.size", "-", 0.0, 0.0, 5.0, 0.0, 0.1, about="psi, relative increase at the wall"),
        Parameter("wall_effect.reach", "m", 0.2, 0.03, 1.0, 0.2, 0.1, about="l, of its decay", shape=True),
    )
    source = "Scott, Trans. RINA 118 (1976): blockage correction; Brennen, NCEL CR 82.010 (1982): walls"
    signature = "right in the middle of the tank, too fast along its walls: it follows the path, not the beat"
    confirm = "swim the same run once along the middle line and once along a wall"
    fingerprint = Fingerprint(exponent=0.0, odd=None, part=None)
    load = _more

    def not_applicable(self, dataset: Dataset) -> str:
        """The distance to a wall needs the tank and where in it each run began."""
        if unknown := next(filter(None, map(self.cannot_act, dataset.trials)), ""):
            return unknown
        if lost := unplaced(dataset):
            return lost
        near = min(float(np.nanmin(t.tank.distance(t.pose))) for t in dataset.trials if t.tank and t.pose is not None)
        if near > _NEAR * self.declaration("reach").high:
            return f"no run comes nearer to a wall than {near:.2g} m"
        return ""

    def cannot_act(self, trial: Trial) -> str:
        """The walls must be known."""
        return "the walls are not known: dataset.toml has no [tank]" * (trial.tank is None)

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the walls, x and then y; without a tank, walls that are nowhere near."""
        return (-1e9, 1e9, -1e9, 1e9) if trial.tank is None else (*trial.tank.x, *trial.tank.y)
