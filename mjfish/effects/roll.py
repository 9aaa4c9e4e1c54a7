"""Rolling about the long axis, out of the plane of the model."""

from __future__ import annotations

import functools

import numpy as np
from scipy.interpolate import BSpline

from mjfish.data import Trial
from mjfish.drive.measured import smoothing_spline
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled
from mjfish.parameters import Parameter

#: Acceleration of gravity [m/s2].
GRAVITY = 9.81
#: Longest step of the pendulum [s]; samples of a camera are further apart.
_STEP = 0.005


class Roll(Effect):
    """The body rolls, and a marker at the height z above the roll axis goes with it, z phi to starboard.

        sway_recorded = sway - z phi'

    phi is positive with port up (about x forward). Where it was measured, phi' is the slope of its smoothing spline and
    the shapes play no part. Elsewhere the fish is a pendulum, its centre of mass by l below the axis, that the side
    force drives. A submerged body that leans by phi is righted by m g l sin phi, and in a frame that accelerates
    sideways by a = sway' + yaw_rate surge the side force turns it by -m a l:

        phi'' + 2 zeta omega phi' + omega^2 sin phi = -(omega^2 / g) (sway' + yaw_rate surge).

    With q = phi' + (omega^2 / g) sway no sway' is needed; q and phi are integrated from rest at the first sample on,
    by Runge-Kutta steps of 5 ms at most, with cubics between the samples of the velocity. What the side force acts on
    besides the weight, added mass above all, is in `height`: without a measured roll it is an effective one.

    Left out are terms of second order: leaning takes cos^2 phi off the normal force, and cos phi off the lever of the
    side force. The surge z phi yaw_rate of the marker in a turn is left out, too: the zero of a measured roll is not
    known well enough for it.
    """

    name, domain, mechanism = "roll", "out_of_plane", "roll"
    summary = "the fish rolls, and the marker with it"
    parameters = (
        Parameter("roll.height", "m", 0.0, -0.2, 0.2, 0.0, 0.003, about="of the marker above the roll axis"),
        Parameter(
            "roll.frequency", "rad/s", 8.0, 1.0, 40.0, 8.0, 1.0, about="natural frequency of the roll", shape=True
        ),
        Parameter("roll.damping", "-", 0.2, 0.02, 1.5, 0.2, 0.05, about="damping ratio of the roll", shape=True),
    )
    source = (
        "Metacentric stability and coupled sway and roll: Fossen, Handbook of Marine Craft Hydrodynamics and Motion "
        "Control (2011), ch. 4 and 7"
    )
    signature = "sway alone is off, most where the beat frequency is near that of the roll"
    confirm = "measure the roll, or tilt the fish by hand, let go, and film the swing from ahead"
    fingerprint = Fingerprint(odd=False, part="everywhere")

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Take the speed of the marker about the roll axis off the sway."""
        read = state.copy()
        read[:, 1] -= values["height"] * _roll(trial.time, state, values, trial)[:, 1]
        return read

    def displacement(self, time: FloatArray, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Swing the marker to starboard by z phi."""
        return np.outer(_roll(time, state, values, trial)[:, 0], [0.0, -values["height"]])


def _roll(time: FloatArray, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
    """Return phi and phi' (m, 2), measured or of the pendulum."""
    measured = _measured(trial)
    if measured is not None:
        return np.column_stack([measured(time), measured(time, nu=1)])
    velocity = state[:, :3].copy()
    return _rolled(time, velocity, np.gradient(velocity, time, axis=0), values["frequency"], values["damping"])


@functools.lru_cache(maxsize=256)
def _measured(trial: Trial) -> BSpline | None:
    """Return the roll that was measured, None where it was not."""
    return None if trial.roll is None else smoothing_spline(trial.time, trial.roll)


@compiled
def _rolled(time: FloatArray, velocity: FloatArray, slope: FloatArray, frequency: float, damping: float) -> FloatArray:
    """Return phi and phi' (n, 2).

    phi' = q - k sway and q' = -2 zeta omega phi' - omega^2 sin phi - k yaw_rate surge, with k = omega^2 / g.

    Args:
        time: (n,) of the samples [s].
        velocity, slope: (n, 3) surge, sway, yaw rate and their time derivatives.
        frequency, damping: omega [rad/s] and zeta.
    """
    n = time.shape[0]
    coupling = frequency * frequency / GRAVITY
    rolled = np.zeros((n, 2))
    phi = 0.0
    q = coupling * velocity[0, 1]
    now = np.empty(3)
    for i in range(n - 1):
        width = time[i + 1] - time[i]
        parts = max(int(np.ceil(width / _STEP)), 1)
        h = width / parts
        for part in range(parts):
            total_phi = 0.0
            total_q = 0.0
            k_phi = 0.0
            k_q = 0.0
            for stage in range(4):
                ahead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                s = (part * h + ahead) / width
                for c in range(3):
                    now[c] = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * velocity[i, c] + s * (1.0 - s) ** 2 * width * slope[
                        i, c
                    ]
                    now[c] += s * s * (3.0 - 2.0 * s) * velocity[i + 1, c] + s * s * (s - 1.0) * width * slope[i + 1, c]
                here = phi + ahead * k_phi
                k_phi = q + ahead * k_q - coupling * now[1]
                k_q = -2.0 * damping * frequency * k_phi - frequency**2 * np.sin(here) - coupling * now[2] * now[0]
                weight = 1.0 if stage == 0 or stage == 3 else 2.0
                total_phi += weight * k_phi
                total_q += weight * k_q
            phi += h / 6.0 * total_phi
            q += h / 6.0 * total_q
        rolled[i + 1, 0], rolled[i + 1, 1] = phi, q - coupling * velocity[i + 1, 1]
    return rolled
