"""What sensors read of a simulated run: the place of a point, a heading, a yaw rate, accelerations.

With the nose at p and heading theta_0, the links turned on by their joints, and e(theta) = (cos theta, sin theta),

    point at station s of link i:   p - sum_{k < i} L_k e(theta_k) - s e(theta_i)
    acceleration at station s of the head, r = (-s, 0):   a = v' + w x v + w' x r + w x (w x r)

in the forward frame, v and w' of the equation of motion itself. Places and headings are then what the camera makes of
them (`mjfish.effects.effect.Effect.camera`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.data import Sensor, Trial
from mjfish.drive.motion import JointMotion
from mjfish.effects.effect import Effect, Values
from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.equation import STATES
from mjfish.ode.rollout import Rollout

#: Steps of the differences of what a camera makes of places [m] and headings [rad]: it is smooth.
_LENGTH, _ANGLE = 1e-4, 1e-4


@dataclass(frozen=True, eq=False)
class Moments:
    """A run at the samples of a sensor, or the rates of all this along a direction.

    Attributes:
        time: (m,) [s].
        state: (m, 8) of the rollout.
        rate: (m, 8) its derivative by time; zeros where no sensor of the trial is inertial. Of rates along directions
            (m, 0, k) where all sensors are pointwise.
        angle: (m, joints) [rad].
        length: (links,) [m].
    """

    time: FloatArray
    state: FloatArray
    rate: FloatArray
    angle: FloatArray
    length: FloatArray

    def moved(self, by: float, along: Moments) -> Moments:
        """Return all this, so far along a direction."""
        return Moments(
            self.time,
            self.state + by * along.state,
            self.rate + by * along.rate,
            self.angle + by * along.angle,
            self.length + by * along.length,
        )

    def largest(self) -> float:
        """Return the largest number of all this but the time."""
        return max(float(np.abs(part).max(initial=0.0)) for part in (self.state, self.rate, self.angle, self.length))

    def part(self, samples: slice) -> Moments:
        """Return some of the samples."""
        time, state, rate, angle = (block[samples] for block in (self.time, self.state, self.rate, self.angle))
        return Moments(time, state, rate, angle, self.length)


def distinct(clocks: Sequence[FloatArray]) -> tuple[list[FloatArray], list[int]]:
    """Return the clocks that differ, and which of these each one is: place and heading are mostly seen at once."""
    keys = [clock.tobytes() for clock in clocks]
    found = dict(zip(keys, clocks, strict=True))
    return [*found.values()], [[*found].index(key) for key in keys]


@dataclass(frozen=True, eq=False)
class Camera:
    """What films a trial: the effects that act on it, with their values by short names."""

    trial: Trial
    effects: Sequence[tuple[Effect, Values]] = ()

    def sees(self, sensor: Sensor) -> bool:
        """Return whether a sensor is read by it: it measures places or headings."""
        return sensor.kind in ("position", "heading")

    def pointwise(self, sensor: Sensor) -> bool:
        """Return whether what it reads of a sample depends on place and heading at that sample alone."""
        return self.sees(sensor) and not any(effect.overrides("displacement") for effect, _ in self.effects)

    def moments(self, fish: Fish, rollout: Rollout, motion: JointMotion, time: FloatArray) -> Moments:
        """Return a run at some times (m,) [s]; what is after its end is read there."""
        at = np.minimum(time, motion.time[-1])
        rate = np.zeros((len(at), STATES)) if all(map(self.sees, self.trial.sensors)) else rollout.rate_at(at)
        return Moments(at, rollout.at(at), rate, motion.angle_at(at), np.array([link.length for link in fish.links]))

    def clocked(self, sensor: Sensor, time: FloatArray) -> FloatArray:
        """Return when what a sensor has at `time` (m,) was seen [s]; a free clock of its own says so itself."""
        if self.sees(sensor) and not sensor.free_clock:
            for effect, values in self.effects:
                time = effect.clock(time, values)
        return time

    def read(self, sensor: Sensor, seen: Moments) -> FloatArray:
        """Return what a sensor reads (m, c), its channels in the order of the sensor."""
        if not self.sees(sensor):
            return np.stack([_INERTIAL[channel](sensor, seen) for channel in sensor.channels], axis=1)
        place, heading = _place(sensor.link, sensor.station, seen)
        for effect, values in self.effects:
            if effect.overrides("displacement"):
                place += frames.to_body(effect.displacement(seen.time, seen.state, values, self.trial), -heading)
        place, heading = self._filmed(seen.time, place, heading)
        return place if sensor.kind == "position" else heading[:, None]

    def filmed_rates(self, link: int, station: float, seen: Moments, along: Moments) -> FloatArray:
        """Return the rates (m, 3, k) of place and heading as sensors that are `pointwise` see them, in k directions.

        Args:
            link, station: of the point that is seen.
            seen: the run.
            along: its rates, the directions behind all other axes.
        """
        (place, heading), (places, headings) = _place(link, station, seen), _place_rates(link, station, seen, along)
        rates = np.concatenate([places, headings[:, None]], axis=1)
        if any(effect.overrides("camera") for effect, _ in self.effects):
            by = np.zeros((len(heading), 3, 3))
            for axis, h in enumerate((_LENGTH, _LENGTH, _ANGLE)):
                step = h * np.eye(3)[axis]
                (there, turned), (back, returned) = [
                    self._filmed(seen.time, place + k * step[:2], heading + k * step[2]) for k in (1.0, -1.0)
                ]
                by[:, :2, axis], by[:, 2, axis] = (there - back) / (2.0 * h), (turned - returned) / (2.0 * h)
            rates = by @ rates
        return rates

    def _filmed(self, time: FloatArray, place: FloatArray, heading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (m, 2) and headings (m,) as the camera sees them."""
        for effect, values in self.effects:
            place, heading = effect.camera(time, place, heading, values, self.trial)
        return place, heading


def _place(link: int, station: float, seen: Moments) -> tuple[FloatArray, FloatArray]:
    """Return place (m, 2) and heading (m,) of a point; the tail's deflection adds to the last joint."""
    place, heading = seen.state[:, 3:5].copy(), seen.state[:, 5].copy()
    last = seen.angle.shape[1] - 1
    for i in range(link):
        place -= seen.length[i] * _direction(heading)
        heading += seen.angle[:, i] + (seen.state[:, 6] if i == last else 0.0)
    return np.asarray(place - station * _direction(heading)), heading


def _place_rates(link: int, station: float, seen: Moments, along: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the rates of place (m, 2, k) and heading (m, k) of a point along k directions."""
    heading, turning = seen.state[:, 5].copy(), along.state[:, 5].copy()
    moving, last = along.state[:, 3:5].copy(), seen.angle.shape[1] - 1
    for i in range(link):
        moving -= _direction(heading)[:, :, None] * along.length[i] + seen.length[i] * _swung(heading, turning)
        heading += seen.angle[:, i] + (seen.state[:, 6] if i == last else 0.0)
        turning += along.angle[:, i] + (along.state[:, 6] if i == last else 0.0)
    moving -= station * _swung(heading, turning)
    return moving, turning


def _swung(heading: FloatArray, turning: FloatArray) -> FloatArray:
    """Return the rates (m, 2, k) of the direction of a heading (m,) that turns by (m, k)."""
    return np.asarray(np.stack([-np.sin(heading), np.cos(heading)], axis=1)[:, :, None] * turning[:, None])


def _direction(heading: FloatArray) -> FloatArray:
    return np.stack([np.cos(heading), np.sin(heading)], axis=1)


_INERTIAL: dict[str, Callable[[Sensor, Moments], FloatArray]] = {
    "yaw_rate": lambda _, seen: seen.state[:, 2],
    "surge_acceleration": lambda sensor, seen: (
        seen.rate[:, 0] - seen.state[:, 2] * seen.state[:, 1] + sensor.station * seen.state[:, 2] ** 2
    ),
    "sway_acceleration": lambda sensor, seen: (
        seen.rate[:, 1] + seen.state[:, 2] * seen.state[:, 0] - sensor.station * seen.rate[:, 2]
    ),
}
