"""First-order lag of the servos."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import cubic
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled
from mjfish.parameters import Parameter

#: A shorter lag is none: the steps behind a step of the drive could not follow its kick [s].
SHORTEST = 5e-5


class ServoLag(ServoForm):
    """The joints follow their command with a first-order lag: tau theta' = theta_command - theta.

    Solved exactly between the samples of the command (its rate as a cubic). The joints start at rest where the command
    starts, theta(0) = theta_command(0): the fish is at rest in the water, and a servo that lags cannot jump to the
    command's rate. However short the lag, the joints' start then kicks the head, which the nominal model's start at the
    command's rate does not.
    """

    name = "servo_lag"
    summary = "the servos follow their command late"
    parameters = (Parameter("servo_lag.time_constant", "s", 0.0, 0.0, 0.5, 0.0, 0.005, about="of the first-order lag"),)
    jerks = False
    source = "Ljung, System Identification (1999), sec. 4.2: process models"
    signature = "late and smaller with frequency; steps of the command come out smooth"
    fingerprint = Fingerprint(exponent=1.0, odd=False, part="everywhere")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Filter the motion; the rate no longer jumps."""
        if values["time_constant"] < SHORTEST:
            return motion
        angle, rate, acceleration = _lag(
            np.diff(motion.time), motion.angle, motion.rate, motion.acceleration, values["time_constant"]
        )
        return JointMotion(time=motion.time, angle=angle, rate=rate, acceleration=acceleration)


@compiled
def _lag(
    steps: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, tau: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solve e' = -e / tau - theta_command' for e = theta - theta_command, half step by half step.

    Over a half step d the command's rate is the cubic a_0 + .. + a_3 s^3 through its values and slopes at both ends, so
    e(d) = E e(0) - sum_k a_k I_k,  E = exp(-d / tau),  I_0 = tau (1 - E),  I_k = tau (d^k - k I_{k-1}).
    """
    n, _, joints = angle.shape
    lagged = np.empty_like(angle)
    lagged_rate = np.empty_like(rate)
    lagged_acceleration = np.empty_like(acceleration)
    error = np.zeros(joints)
    for step in range(n):
        d = 0.5 * steps[step]
        decay = np.exp(-d / tau)
        i0 = -tau * np.expm1(-d / tau)
        i1 = tau * (d - i0)
        i2 = tau * (d * d - 2.0 * i1)
        i3 = tau * (d * d * d - 3.0 * i2)
        for stage in range(3):
            for j in range(joints):
                if stage > 0:
                    a0 = rate[step, stage - 1, j]
                    a1 = acceleration[step, stage - 1, j]
                    a2, a3 = cubic(a0, a1, rate[step, stage, j], acceleration[step, stage, j], d)
                    error[j] = decay * error[j] - a0 * i0 - a1 * i1 - a2 * i2 - a3 * i3
                follow = -error[j] / tau
                lagged[step, stage, j] = angle[step, stage, j] + error[j]
                lagged_rate[step, stage, j] = follow
                lagged_acceleration[step, stage, j] = (rate[step, stage, j] - follow) / tau
    return lagged, lagged_rate, lagged_acceleration
