"""Forces of the water in foreign forms: drag laws, lift, and what becomes of the added momentum; compiled.

Every form is an excess over the nominal water of a link that moves at u along (to its rear), v across, and turns at om.
"""

from __future__ import annotations

import numpy as np

from studies.battery.generator.compiled import compiled

#: Numbers of the forms in the kernel.
FORMS = {
    name: number + 1
    for number, name in enumerate(
        (
            "random_drag",
            "reynolds_decay",
            "whole_speed_power",
            "drag_crisis",
            "random_lift",
            "stalling_fin",
            "body_stream_lift",
            "shed_momentum",
            "munk_of_body",
        )
    )
}
#: Knots of a random curve in ln(speed / 0.3 m/s): the first, their distance, their number; constant outside.
FIRST_KNOT, KNOT_STEP, KNOTS = -4.2, 0.35, 19
REFERENCE_SPEED = 0.3
#: Harmonics sin 2 k alpha of a random lift.
HARMONICS = 4
_VISCOSITY = 1.0e-6  # [m2/s]
#: Slower counts as this fast where a power would have no value at rest [m/s].
_SLOW = 0.003
_RANDOM_DRAG, _DECAY, _POWER, _CRISIS = (
    FORMS[n] for n in ("random_drag", "reynolds_decay", "whole_speed_power", "drag_crisis")
)
_RANDOM_LIFT, _STALLING, _BODY = (FORMS[n] for n in ("random_lift", "stalling_fin", "body_stream_lift"))
_SHED, _MUNK = FORMS["shed_momentum"], FORMS["munk_of_body"]


@compiled
def curve(x, w, first):  # type: ignore[no-untyped-def]
    """Return a curve at x through KNOTS values from w[first] on: cubics with the slopes of central differences."""
    s = min(max((x - FIRST_KNOT) / KNOT_STEP, 0.0), KNOTS - 1.0)
    left = min(int(s), KNOTS - 2)
    t = s - left
    a = w[first + left]
    b = w[first + left + 1]
    p = 0.5 * (b - w[first + max(left - 1, 0)])
    q = 0.5 * (w[first + min(left + 2, KNOTS - 1)] - a)
    return a + t * (p + t * (3.0 * (b - a) - 2.0 * p - q + t * (p + q - 2.0 * (b - a))))


@compiled
def _across(form, u, q, height, w):  # type: ignore[no-untyped-def]
    """Return the relative excess of c_d of a strip; w are the numbers of the form."""
    if form == _RANDOM_DRAG:
        return np.expm1(w[0] * curve(np.log((abs(q) + 1e-9) / REFERENCE_SPEED), w, 1))
    if form == _DECAY:
        return w[1] * np.exp(-np.sqrt(u * u + q * q) * height / (_VISCOSITY * w[2]))
    if form == _POWER:
        return (max(np.sqrt(u * u + q * q), _SLOW) / REFERENCE_SPEED) ** w[1] - 1.0
    return w[0] / (1.0 + (abs(q) / w[2]) ** (2.0 / w[4]))


@compiled
def _along(form, u, q, height, w):  # type: ignore[no-untyped-def]
    """Return the relative excess of c_f of a strip."""
    if form == _RANDOM_DRAG:
        return np.expm1(w[0] * curve(np.log((abs(u) + 1e-9) / REFERENCE_SPEED), w, 1 + KNOTS))
    if form == _DECAY:
        return w[0] * np.exp(-np.sqrt(u * u + q * q) * height / (_VISCOSITY * w[2]))
    if form == _POWER:
        return (max(np.sqrt(u * u + q * q), _SLOW) / REFERENCE_SPEED) ** w[0] - 1.0
    return w[1] * w[0] / (1.0 + (abs(u) / w[3]) ** (2.0 / w[4]))


@compiled
def _drag(form, link, r, k, height, ring, u, v, om, w):  # type: ignore[no-untyped-def]
    """Return the excess of a law of drag: force along, across, moment about the joint."""
    local = form == _RANDOM_DRAG or form == _CRISIS  # friction by the speed along alone
    friction = _along(form, u, 0.0, 0.0, w) if local else 0.0
    across = 0.0
    moment = 0.0
    for s in range(r.shape[0]):
        q = v + om * r[s]
        d = k[s] * _across(form, u, q, height[s], w) * abs(q) * q
        across -= d
        moment -= d * r[s]
        if not local:
            friction += ring[s] / link[8] * _along(form, u, q, height[s], w)
    return -link[7] * friction * abs(u) * u, across, moment


@compiled
def _coefficient(form, sine, cosine, w):  # type: ignore[no-untyped-def]
    """Return C_L at an angle of attack."""
    if form == _RANDOM_LIFT:
        angle = np.arctan2(sine, cosine)
        total = 0.0
        for k in range(HARMONICS):
            total += w[2 + k] * np.sin(2.0 * (k + 1) * angle)
        return w[0] * total
    double = 2.0 * sine * cosine
    if form == _STALLING:
        return w[0] * double * (1.0 - w[1] * sine * sine)
    return w[0] * double


@compiled
def _lift(form, link, rho, u, v, om, w):  # type: ignore[no-untyped-def]
    """Return the lift of a link, across the stream at one place of its chord."""
    place = link[0] * (w[2] if form == _STALLING else w[1])
    q = v + place * om
    speed = np.sqrt(u * u + q * q)
    if speed < 1e-9:
        return 0.0, 0.0, 0.0
    lift = 0.5 * rho * link[9] * _coefficient(form, q / speed, abs(u) / speed, w) * speed
    back = 1.0 if u > 0.0 else -1.0
    return back * lift * q, -lift * abs(u), -lift * abs(u) * place


@compiled
def excess(last, link, rho, r, k, height, ring, u, v, om, form, w):  # type: ignore[no-untyped-def]
    """Return what a foreign form adds to the nominal water of one link: force along, across, moment about its joint.

    Args:
        last: whether it is the last link.
        link: row of `studies.battery.generator.body.Body.links`.
        rho: density.
        r, k, height, ring: of its strips.
        u, v, om: velocity of its joint along and across, and its turn.
        form: number of the form.
        w: the numbers of the form.
    """
    if form <= _CRISIS:
        return _drag(form, link, r, k, height, ring, u, v, om, w)
    if form <= _BODY:
        if last == (form == _BODY):
            return 0.0, 0.0, 0.0
        return _lift(form, link, rho, u, v, om, w)
    if form == _MUNK:
        if last:
            return 0.0, 0.0, 0.0
        return 0.0, 0.0, -w[0] * u * (link[4] * v + link[5] * om)
    if not last:
        return 0.0, 0.0, 0.0
    # Lighthill: the section at the end leaves its momentum m q behind, and is pushed by m q^2 / 2.
    q = v + link[0] * om
    mass = w[0] * link[10]
    side = mass * q * u if u < 0.0 else 0.0
    return -0.5 * mass * q * q, side, side * link[0]
