"""Forces of the water and of the tank on the strips of one link, and where their sizes sit in the kernel's numbers."""

from __future__ import annotations

import numpy as np

from studies.battery.generator.compiled import compiled
from studies.battery.generator.other_water import KNOTS

#: Names of the numbers `w` that the kernel reads, in order.
NUMBERS = (
    "density",
    "kappa",  # share of the Munk moment
    "re_friction",  # c_f (1 + a (U0 / |u|)^m)
    "re_pressure",
    "re_exponent",
    "re_speed",
    "linear_along",  # [N s/m3] a wetted area
    "linear_across",  # a height and length
    "lift",
    "cubic",  # c_d (1 + a |q| / U0)
    "tether",  # [N/m]
    "tether_x",
    "tether_y",
    "torque",  # -torque sin(yaw - torque_yaw) [N m]
    "torque_yaw",
    "tail_side",  # side force of the last link a u |u| [kg/m]
    "viscosity",  # friction grows by this share a second
    "stiffness",  # of the last joint [N m/rad]; 0 is rigid
    "damping",
    "memory",  # share of the crossflow drag that comes late
    "memory_time",  # [s]
    "wall",  # drag (1 + a exp(-d / length)) at the distance d of the nose
    "wall_length",  # [m]
    "wall_x0",
    "wall_x1",
    "wall_y0",
    "wall_y1",
    "tail_hardening",  # moment of the last joint: deflection times 1 + h d^2 + g tanh^2(d / bend)
    "tail_gain",
    "tail_bend",  # [rad]
    "slip_size",  # roll by the side force, which takes cos^2 off the drag across; of that of a pendulum
    "slip_frequency",  # [rad/s]
    "slip_damping",
    "form",  # of other_water, and its numbers
    *(f"form_{k}" for k in range(1 + 2 * KNOTS)),
)
W = {name: index for index, name in enumerate(NUMBERS)}
_KF, _RF, _RP, _RE, _RS = (W[n] for n in ("viscosity", "re_friction", "re_pressure", "re_exponent", "re_speed"))
_LA, _LC, _LIFT, _CUBIC, _SIDE = (W[n] for n in ("linear_along", "linear_across", "lift", "cubic", "tail_side"))
_STIFF, _HARD, _GAIN, _BEND = (W[n] for n in ("stiffness", "tail_hardening", "tail_gain", "tail_bend"))

_WALL = W["wall"]


def numbers(**given: float) -> np.ndarray:
    """Return the kernel's numbers: nothing but the nominal water, and what is given."""
    w = np.zeros(len(NUMBERS))
    w[W["density"]] = 1000.0
    w[_RE], w[_RS] = 0.37, 0.3
    w[W["memory_time"]], w[W["wall_length"]], w[W["tail_bend"]] = 0.15, 0.2, 1.0
    for name, value in given.items():
        w[W[name]] = value
    return w


@compiled
def across_plain(r, k, v, om):  # type: ignore[no-untyped-def]
    """Return force and moment about the joint of -k |q| q over strips at q = v + om r."""
    force = 0.0
    moment = 0.0
    for s in range(r.shape[0]):
        q = v + om * r[s]
        d = k[s] * abs(q) * q
        force -= d
        moment -= d * r[s]
    return force, moment


@compiled
def across_changed(r, k, side, v, om, w):  # type: ignore[no-untyped-def]
    """Return the same where the law of drag is another."""
    force = 0.0
    moment = 0.0
    for s in range(r.shape[0]):
        q = v + om * r[s]
        speed = abs(q)
        factor = speed * (1.0 + w[_CUBIC] * speed / w[_RS])
        if w[_RP] != 0.0:
            factor += w[_RP] * w[_RS] ** w[_RE] * speed ** (1.0 - w[_RE])
        d = k[s] * factor * q + w[_LC] * side[s] * q
        force -= d
        moment -= d * r[s]
    return force, moment


@compiled
def along(kf, wetted, u, t, w):  # type: ignore[no-untyped-def]
    """Return the friction along a link; kf its coefficient, wetted its area."""
    speed = abs(u)
    factor = speed
    if w[_RF] != 0.0:
        factor += w[_RF] * w[_RS] ** w[_RE] * speed ** (1.0 - w[_RE])
    return -kf * (1.0 + w[_KF] * t) * factor * u - w[_LA] * wetted * u


@compiled
def on_tail(link, rho, u, v, om, w):  # type: ignore[no-untyped-def]
    """Return side force and moment on the last link: lift of a thin foil, and what a bent fin adds.

    The foil's downwash is taken at 0.7 of its chord and its force acts at 0.27: near three quarters and one quarter.
    """
    foil = -0.5 * rho * w[_LIFT] * link[9] * abs(u) * (v + 0.7 * link[0] * om)
    bent = w[_SIDE] * u * abs(u)
    return foil + bent, link[0] * (0.27 * foil + 0.5 * bent)


@compiled
def near_wall(x, y, w):  # type: ignore[no-untyped-def]
    """Return the factor of all drag at a place of the nose."""
    if w[_WALL] == 0.0:
        return 1.0
    distance = min(min(x - w[_WALL + 2], w[_WALL + 3] - x), min(y - w[_WALL + 4], w[_WALL + 5] - y))
    return 1.0 + w[_WALL] * np.exp(-max(distance, 0.0) / w[_WALL + 1])


@compiled
def spring(bend, w):  # type: ignore[no-untyped-def]
    """Return the moment of the last joint's spring."""
    more = w[_HARD] * bend * bend + w[_GAIN] * np.tanh(bend / w[_BEND]) ** 2
    return w[_STIFF] * bend * (1.0 + more)
