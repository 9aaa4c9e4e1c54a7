"""Steady current in the tank that is another from place to place."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects.ambient_current import AmbientCurrent
from mjfish.effects.effect import Effect, Fingerprint, Values, variant
from mjfish.effects.place import begun_at, unplaced
from mjfish.fish import Fish
from mjfish.hydro.force import crossflow, crossflow_derivatives
from mjfish.hydro.load import PARAMETERS, PLACES, load
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged
from mjfish.parameters import Parameter

#: Columns of the derivatives that are not zero: by c_x, c_y, g_x, g_y, then by u, v, w, x, y, heading and the clock.
_COLUMNS = (0, 1, 3, 4, *range(PARAMETERS, PARAMETERS + 6), PARAMETERS + PLACES)
_SEEDS = tuple(map(tuple, np.eye(len(_COLUMNS)).tolist()))


@merged
def _around(
    x: float, y: float, heading: float, clock: float, parameters: Any
) -> tuple[float, float, float, float, float, float]:
    """Return the velocity of the frame (x, y), that of the water at a link in this frame (x, y), strain and turn.

    Axes are those of the world. The frame moves with the current at the start of the run. In it the water moves with
    c' = G xi at the distance xi from that place, and the place moves on with the clock.
    """
    shear_x, shear_y = parameters[3], parameters[4]
    start_x, start_y = parameters[5], parameters[6]
    frame_x, frame_y = parameters[0] + shear_x * start_y, parameters[1] + shear_y * start_x
    cos, sin = np.cos(heading), np.sin(heading)
    # The water at the link's origin, in the world; e = (cos, sin) points ahead, n = (-sin, cos) to port.
    water_x = shear_x * (y - start_y + clock * frame_y)
    water_y = shear_y * (x - start_x + clock * frame_x)
    strain = (shear_x + shear_y) * sin * cos  # e G e, and -n G n
    turn = shear_y * cos * cos - shear_x * sin * sin  # n G e
    return frame_x, frame_y, water_x, water_y, strain, turn


def _slopes(link: Any, parameters: Any, out: Any) -> None:
    """Write the derivatives of the force: `_sheared` differentiated line by line, once for each column."""
    shear_x, shear_y, clock = parameters[3], parameters[4], link.memory[0]
    frame_x, frame_y, water_x, water_y, strain, turn = _around(link.x, link.y, link.heading, link.memory[0], parameters)
    cos, sin = np.cos(link.heading), np.sin(link.heading)
    u, v, w = link.u, link.v, link.w
    ahead, v_water = cos * water_x + sin * water_y, sin * water_x - cos * water_y
    pull_x, pull_y = shear_x * (frame_y + water_y), shear_y * (frame_x + water_x)
    _, _, f_v, f_w, g_v, g_w = crossflow_derivatives(
        v - v_water, w - turn, link.length, link.node_height, link.height_moment
    )
    _, _, still_v, still_w, still_gv, still_gw = crossflow_derivatives(
        v, w, link.length, link.node_height, link.height_moment
    )
    across = -0.5 * link.density * link.c_d
    friction = -link.density * link.c_f * link.wetted
    slip = u + ahead - 0.5 * link.length * strain
    a0, a1, a2 = link.c_m * link.added[0], link.c_m * link.added[1], link.c_m * link.added[2]
    momentum, less = a0 * v + a1 * w, a0 * v_water + a1 * turn
    for column, seed in zip(_COLUMNS, _SEEDS):  # noqa: B905 # numba knows no strict
        c_x, c_y, g_x, g_y, du, dv, dw, dx, dy, turned, later = seed
        to_x, to_y = c_x + g_x * parameters[6], c_y + g_y * parameters[5]  # of the frame
        along_x = g_x * (link.y - parameters[6] + clock * frame_y) + shear_x * (dy + later * frame_y + clock * to_y)
        along_y = g_y * (link.x - parameters[5] + clock * frame_x) + shear_y * (dx + later * frame_x + clock * to_x)
        strained = (g_x + g_y) * sin * cos + (shear_x + shear_y) * (cos * cos - sin * sin) * turned
        turning = g_y * cos * cos - g_x * sin * sin - 2.0 * strain * turned
        more_ahead = cos * along_x + sin * along_y - v_water * turned
        aside = sin * along_x - cos * along_y + ahead * turned
        carried = cos * (g_y * frame_x + shear_y * to_x) - sin * (g_x * frame_y + shear_x * to_y)
        carried -= (sin * shear_y * frame_x + cos * shear_x * frame_y) * turned
        v_rate = dw * ahead + w * more_ahead - carried + du * turn + u * turning - dv * strain - v * strained
        turn_rate = -2.0 * (dw * strain + w * strained)
        pulled_x = g_x * (frame_y + water_y) + shear_x * (to_y + along_y)
        pulled_y = g_y * (frame_x + water_x) + shear_y * (to_x + along_x)
        pressure_x = (g_x * shear_y + shear_x * g_y) * link.com - cos * pulled_x - sin * pulled_y
        pressure_x += (sin * pull_x - cos * pull_y) * turned
        pressure_y = link.mass * (sin * pulled_x - cos * pulled_y + (cos * pull_x + sin * pull_y) * turned)
        slipped = du + more_ahead - 0.5 * link.length * strained
        lessened = a0 * aside + a1 * turning
        out[0, column] = friction * (abs(slip) * slipped - abs(u) * du) - dw * less - w * lessened
        out[0, column] += link.mass * pressure_x
        force = f_v * (dv - aside) + f_w * (dw - turning) - still_v * dv - still_w * dw
        out[1, column] = across * force + a0 * v_rate + a1 * turn_rate + pressure_y
        moment = g_v * (dv - aside) + g_w * (dw - turning) - still_gv * dv - still_gw * dw
        munk = slipped * (momentum - less) + slip * (a0 * dv + a1 * dw - lessened) - du * momentum
        munk -= u * (a0 * dv + a1 * dw)
        out[2, column] = across * moment + a1 * v_rate + a2 * turn_rate + link.com * pressure_y - link.munk * munk


@load(memory=1, shared=True, gradient=_slopes)
def _sheared(link: Any, parameters: Any) -> tuple[float, float, float, float]:
    """Return the force in the current less that in still water, and the rate of the clock; see `_around`."""
    shear_x, shear_y = parameters[3], parameters[4]
    frame_x, frame_y, water_x, water_y, strain, turn = _around(link.x, link.y, link.heading, link.memory[0], parameters)
    cos, sin = np.cos(link.heading), np.sin(link.heading)
    u, v, w = link.u, link.v, link.w
    # In the frame of the link, which points to tail and starboard; along it, at its middle.
    ahead = cos * water_x + sin * water_y
    u_water = 0.5 * link.length * strain - ahead
    v_water = sin * water_x - cos * water_y
    # Rates of v_water and of turn along the way of the origin: dn/dt = -w e, d xi / dt = c - u e - v n.
    carried = cos * shear_y * frame_x - sin * shear_x * frame_y  # n G c of the frame
    v_rate = w * ahead - carried + u * turn - v * strain
    turn_rate = -2.0 * w * strain
    # Acceleration of the water G c, on the mass that the link displaces, its own.
    pull_x, pull_y = shear_x * (frame_y + water_y), shear_y * (frame_x + water_x)
    pressure_x = link.mass * (shear_x * shear_y * link.com - cos * pull_x - sin * pull_y)
    pressure_y = link.mass * (sin * pull_x - cos * pull_y)
    force, moment = crossflow(v - v_water, w - turn, link.length, link.node_height, link.height_moment)
    still_force, still_moment = crossflow(v, w, link.length, link.node_height, link.height_moment)
    across = -0.5 * link.density * link.c_d
    friction = -0.5 * link.density * link.c_f * link.wetted
    slip = u - u_water
    a0, a1, a2 = link.c_m * link.added[0], link.c_m * link.added[1], link.c_m * link.added[2]
    momentum = a0 * v + a1 * w
    less = a0 * v_water + a1 * turn
    fx = friction * (abs(slip) * slip - abs(u) * u) - w * less + pressure_x
    fy = across * (force - still_force) + a0 * v_rate + a1 * turn_rate + pressure_y
    mz = across * (moment - still_moment) + a1 * v_rate + a2 * turn_rate + link.com * pressure_y
    mz -= link.munk * (slip * (momentum - less) - u * momentum)
    return fx, fy, mz, link.last


class ShearedCurrent(AmbientCurrent):
    """The water moves with a velocity that is linear in the place: c = (c_x + g_x y, c_y + g_y x), x, y of the world.

    g_x = -g_y turns the water as a whole, one of them alone is a stream beside still water. Drag, added mass and Munk's
    moment go with the velocity through the water around each link, V - c, and the water pushes the fish as it pushed
    the water in its place, with m (dc/dr) c. A run is simulated in the frame that moves with the current c_s at the
    place where it begins, as in `AmbientCurrent`. A fish that was adrift there is carried and turned by the water:

        V(0) = c(middle of the fish),  w(0) = (1 - h) n (dc/dr) e,    h = 0 adrift, 1 held (V(0) = 0),

    e along the fish, n to port. Other forces of the water feel c_s only, not how c changes with the place.
    """

    name = "sheared_current"
    summary = "the water in the tank moves, and not everywhere alike"
    parameters = (
        Parameter("sheared_current.x", "m/s", 0.0, -0.5, 0.5, 0.0, 0.01, about="current along world x at the origin"),
        Parameter("sheared_current.y", "m/s", 0.0, -0.5, 0.5, 0.0, 0.01, about="current along world y at the origin"),
        Parameter(
            "sheared_current.held", "-", 0.0, 0.0, 1.0, 0.5, 0.1, about="0 adrift at the start, 1 held", shape=True
        ),
        Parameter("sheared_current.shear_x", "1/s", 0.0, -1.0, 1.0, 0.0, 0.02, about="g_x, of x per metre of y"),
        Parameter("sheared_current.shear_y", "1/s", 0.0, -1.0, 1.0, 0.0, 0.02, about="g_y, of y per metre of x"),
    )
    source = (
        "Batchelor, An Introduction to Fluid Dynamics (1967), sec. 2.3: linear flow; Morison's force of relative motion"
    )
    signature = "an offset of surge and sway that turns with the heading and differs from place to place"
    confirm = "let the fish drift without drive at several places of the tank"
    #: No power of the frequency: the uniform part is an offset, but a faster fish also comes to other water.
    fingerprint = Fingerprint(exponent=None, odd=None, part="everywhere")
    limits = ("ambient_current",)
    load = _sheared
    length: ClassVar[float] = 0.6  # of the fish [m]

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with the length of the fish."""
        return variant(ShearedCurrent, length=sum(link.length for link in fish.links))

    def not_applicable(self, dataset: Dataset) -> str:
        """The water is another at each place, so that the place must be known."""
        return unplaced(dataset)

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the numbers of a current that is the same everywhere."""
        return {**values, "shear_x": 0.0, "shear_y": 0.0} if formula == "ambient_current" else {}

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the place where the run begins."""
        return tuple(begun_at(trial)[:2].tolist())

    def start(self, velocity: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Begin against the water, as far as the fish was held; as far as it was not, turn with it."""
        begun = super().start(velocity, _at_start(values, trial), trial)
        if not trial.starts_at_rest:
            return begun
        yaw = float(begun_at(trial)[2])
        cos, sin = np.cos(yaw), np.sin(yaw)
        strain = (values["shear_x"] + values["shear_y"]) * sin * cos
        turn = values["shear_y"] * cos**2 - values["shear_x"] * sin**2
        return np.asarray(begun + (1.0 - values["held"]) * np.array([-0.5 * self.length * strain, 0.0, turn]))

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Add the current of the frame, that at the start, to velocity and place."""
        return super().reading(state, _at_start(values, trial), trial)

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Add the way of the frame."""
        return super().camera(time, place, heading, _at_start(values, trial), trial)


def _at_start(values: Values, trial: Trial) -> dict[str, float]:
    """Return the numbers of the uniform current that is there where the run begins."""
    x, y, _ = begun_at(trial)
    along = {"x": values["x"] + values["shear_x"] * y, "y": values["y"] + values["shear_y"] * x}
    return {**along, "held": values["held"]}
