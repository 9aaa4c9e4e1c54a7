"""What sensors read of a simulated run: the place of a point, a heading, a yaw rate, accelerations.

With the nose at p and heading theta_0, the links turned on by their joints, and e(theta) = (cos theta, sin theta),

    point at station s of link i:   p - sum_{k < i} L_k e(theta_k) - s e(theta_i)
    acceleration at station s of the head, r = (-s, 0):   a = v' + w x v + w' x r + w x (w x r)

in the forward frame, v and w' of the equation of motion itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Sensor
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.ode.rollout import Rollout


@dataclass(frozen=True, eq=False)
class Moments:
    """A run at the samples of a sensor, or the rates of all this along a direction.

    Attributes:
        state: (m, 8) of the rollout.
        rate: (m, 8) its derivative by time.
        angle: (m, joints) [rad].
        length: (links,) [m].
    """

    state: FloatArray
    rate: FloatArray
    angle: FloatArray
    length: FloatArray

    def moved(self, by: float, along: Moments) -> Moments:
        """Return all this, so far along a direction."""
        return Moments(
            self.state + by * along.state,
            self.rate + by * along.rate,
            self.angle + by * along.angle,
            self.length + by * along.length,
        )


def moments(fish: Fish, rollout: Rollout, motion: JointMotion, time: FloatArray) -> Moments:
    """Return a run at some times (m,) [s]; what is after its end is read there."""
    at = np.minimum(time, motion.time[-1])
    length = np.array([link.length for link in fish.links])
    return Moments(rollout.at(at), rollout.rate_at(at), motion.angle_at(at), length)


def read(sensor: Sensor, seen: Moments) -> FloatArray:
    """Return what a sensor reads (m, c), its channels in the order of the sensor."""
    return np.stack([_CHANNELS[channel](sensor, seen) for channel in sensor.channels], axis=1)


def _place(sensor: Sensor, seen: Moments) -> FloatArray:
    """Return the place (m, 2) of a sensor; the tail's deflection adds to the last joint."""
    place, heading = seen.state[:, 3:5].copy(), seen.state[:, 5].copy()
    last = seen.angle.shape[1] - 1
    for i in range(sensor.link):
        place -= seen.length[i] * _direction(heading)
        heading += seen.angle[:, i] + (seen.state[:, 6] if i == last else 0.0)
    return np.asarray(place - sensor.station * _direction(heading))


def _direction(heading: FloatArray) -> FloatArray:
    return np.stack([np.cos(heading), np.sin(heading)], axis=1)


def _surge_acceleration(sensor: Sensor, seen: Moments) -> FloatArray:
    turning = seen.state[:, 2]
    return np.asarray(seen.rate[:, 0] - turning * seen.state[:, 1] + sensor.station * turning**2)


def _sway_acceleration(sensor: Sensor, seen: Moments) -> FloatArray:
    return np.asarray(seen.rate[:, 1] + seen.state[:, 2] * seen.state[:, 0] - sensor.station * seen.rate[:, 2])


_CHANNELS: dict[str, Callable[[Sensor, Moments], FloatArray]] = {
    "x": lambda sensor, seen: _place(sensor, seen)[:, 0],
    "y": lambda sensor, seen: _place(sensor, seen)[:, 1],
    "yaw": lambda _, seen: seen.state[:, 5],
    "yaw_rate": lambda _, seen: seen.state[:, 2],
    "surge_acceleration": _surge_acceleration,
    "sway_acceleration": _sway_acceleration,
}
