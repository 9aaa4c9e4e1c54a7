"""Servos of limited speed."""

from __future__ import annotations

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import limited
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.parameters import Parameter


class ServoRateLimit(ServoForm):
    """The joints turn no faster than L = 1 / slowness: they fall behind a faster command and catch up with it.

        theta' = L S((c' + k (c - theta)) / L),  S(x) = x / (1 + |x|^n)^(1/n),  n = 256,  theta(0) = c(0),  k = 100 / s

    with the command c. Below the limit S(x) = x, to 1e-14 at nine tenths of it, so that theta = c; above,
    |theta'| < L. As k and n grow this is the rate limiter with a sharp corner that tracks its command,
    sat(x) = sign(x) min(|x|, 1). The corner is as sharp as the step of the integrator can follow: a rounder one takes
    speed from joints that only come near the limit, which is most of what a limit that is hardly met does.

    Not smooth at the null: joints slower than the limit do not feel it, so that the derivatives there are all zero.
    """

    name = "servo_rate_limit"
    summary = "the servos are too slow for their command"
    parameters = (
        Parameter("servo_rate_limit.slowness", "s/rad", 0.0, 0.0, 0.5, 0.1, 0.03, about="1 / (largest rate)"),
    )
    source = "Rate limiter of an actuator: Fielding and Flux, Aeronautical Journal 107 (2003)"
    signature = "nothing at low frequency; above a frequency the tail swings less and later, as triangles"
    confirm = "log the joint angles on the bench while the command steps, and read the largest rate"
    fingerprint = Fingerprint(odd=False, part="everywhere")
    resembles = ("stuck-clipped",)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Let the joints follow as fast as they may."""
        return limited(motion, values["slowness"])
