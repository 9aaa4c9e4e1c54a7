"""Sensors of a run beside its velocities, or instead of them: a tracked point, a heading, an inertial unit.

Each has a clock and a rate of its own. What it measures is predicted as it is; nothing is differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from scipy import signal

from mjfish.data import columns
from mjfish.errors import InputError
from mjfish.files.plain_data import unsaved
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly

Kind = Literal["position", "heading", "imu", "gyro"]
#: What each kind measures, as the columns of its file have it.
CHANNELS_OF: dict[Kind, tuple[str, ...]] = {
    "position": ("x", "y"),
    "heading": ("yaw",),
    "imu": ("yaw_rate", "surge_acceleration", "sway_acceleration"),
    "gyro": ("yaw_rate",),
}
#: Kinds whose reading depends on where they sit, and those that sit on the head.
PLACED, ON_HEAD = ("position", "imu"), ("heading", "imu", "gyro")
#: Fewest samples: the first sigma is that of third differences.
FEWEST = 8
#: Values that stand still are no chance where they are so many times as frequent as rounding makes them.
_OFTENER = 3.0


@dataclass(frozen=True, eq=False)
class Sensor:
    """One sensor on one run.

    Attributes:
        name: of the sensor; the same one has the same name in every run.
        kind: ``position`` of a point of the fish in the world, ``heading`` of its head, ``imu`` on its head, ``gyro``:
            an imu without accelerations.
        time: (m,) increasing [s]; 0 is that of the run, but for an offset that `free_clock` allows.
        values: (m, c) of the channels: x, y [m]; yaw [rad], without jumps of a turn; yaw rate [rad/s], and the
            accelerations at the place [m/s2], forward and to port, of the motion in the plane alone.
        link: on which link it sits, from 0 at the head.
        station: how far behind the front of that link [m].
        placed: whether that was measured; else it is a guess, and a camera's offset from there is free in a fit.
        sigma: (c,) standard deviation of one sample; None: estimated from the data.
        free_clock: whether its clock has an unknown offset in each run.
        source: the file it was read from.
        remarks: what was left out, in words.

    Example:
        >>> import mjfish
        >>> from mjfish.data import Sensor
        >>> tag = Sensor("tag", "position", time=[0.0, 0.1], values=[[0.0, 0.0], [0.02, 0.01]], station=0.1)
        >>> tag.channels
        ('x', 'y')
    """

    name: str
    kind: Kind
    time: FloatArray
    values: FloatArray
    link: int = unsaved(default=0)
    station: float = unsaved(default=0.0)
    placed: bool = unsaved(default=True)
    sigma: FloatArray | None = unsaved(default=None)
    free_clock: bool = unsaved(default=False)
    source: Path | None = unsaved(default=None)
    remarks: tuple[str, ...] = unsaved(default=())

    def __post_init__(self) -> None:
        """Make the arrays read-only; refuse shapes that do not fit."""
        for name in (name for name in ("time", "values", "sigma") if getattr(self, name) is not None):
            object.__setattr__(self, name, readonly(getattr(self, name)))
        wide = len(self.channels)
        if self.values.shape != (len(self.time), wide) or (self.sigma is not None and self.sigma.shape != (wide,)):
            raise InputError(
                f"sensor '{self.name}': values of shape {self.values.shape} and sigma {self.sigma} for "
                f"{len(self.time)} times; expected a column and a sigma for each of {', '.join(self.channels)}"
            )

    def __repr__(self) -> str:
        """Return one line: name, kind and sampling."""
        return f"<Sensor '{self.name}', {self.kind}: {len(self.time)} samples at {1.0 / self.step:.4g} Hz>"

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the columns of `values`."""
        return CHANNELS_OF[self.kind]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the channels."""
        return tuple(columns.UNITS[channel] for channel in self.channels)

    @property
    def clock(self) -> str:
        """Name, without that of the run, of the parameter of a free clock [s]."""
        return f"{self.name}.clock_offset"

    @cached_property
    def step(self) -> float:
        """Step between samples [s]: the median."""
        return float(np.median(np.diff(self.time)))

    def selected(self, chosen: BoolArray, remark: str) -> Sensor:
        """Return the samples chosen (m,), with a remark that says which and how many were left out, if any were."""
        lost = int(np.count_nonzero(~chosen))
        if not lost:
            return self
        said = f"{self.name}: {lost} of {len(chosen)} samples left out: {remark}"
        return replace(self, time=self.time[chosen], values=self.values[chosen], remarks=(*self.remarks, said))


def cleaned(sensor: Sensor, source: Path, first_line: int | None = None) -> Sensor:
    """Return a sensor without dropouts and repeated samples, its heading without jumps of a turn.

    A sample is repeated where a time comes twice, or where all channels stand still: a slower sensor, logged faster.
    Values that were rounded stand still by chance, about as often as they change by the last digit; these are kept.

    Args:
        sensor: as read; values may be NaN.
        source: its file, for messages.
        first_line: of the numbers in it, see `row_name`.

    Raises:
        InputError: times that run backwards, or hardly any sample.
    """
    columns.check_increasing(sensor.time, source, first_line, repeated=True)
    sensor = sensor.selected(np.all(np.isfinite(sensor.values), axis=1), "a value is missing")
    sensor = sensor.selected(np.diff(sensor.time, prepend=-np.inf) > 0.0, "their time repeats the one before")
    same = np.all(np.diff(sensor.values, axis=0) == 0.0, axis=1)
    if np.count_nonzero(same) > _OFTENER * len(same) * np.prod([_rounding(own) for own in sensor.values.T]):
        remark = "they repeat the values before, as a slower sensor does that is logged faster"
        sensor = sensor.selected(np.append(True, ~same), remark)
    if len(sensor.time) < FEWEST:
        raise InputError(
            f"{source}: {len(sensor.time)} samples of '{sensor.name}' can be used, expected {FEWEST} or more; "
            + ("; ".join(sensor.remarks) or "record longer")
        )
    return replace(sensor, values=np.unwrap(sensor.values, axis=0)) if sensor.kind == "heading" else sensor


def _rounding(values: FloatArray) -> float:
    """Return the last digit of values (m,) over the usual step between them: how often they repeat by chance."""
    digit, steps = (np.abs(np.diff(found)) for found in (np.unique(values), values))
    least = 1e-9 * float(digit.sum())
    return float(digit[digit > least].min() / np.median(steps[steps > least])) if least else 1.0


def within(sensor: Sensor, first: float, last: float, source: Path | str) -> Sensor:
    """Return the samples of a sensor from `first` to `last` [s], the times of its run.

    Raises:
        InputError: they do not overlap.
    """
    inside = (sensor.time >= first - 1e-9) & (sensor.time <= last + 1e-9)
    if np.count_nonzero(inside) < FEWEST:
        raise InputError(
            f"{source}: its times, {sensor.time[0]:.6g} to {sensor.time[-1]:.6g} s, hardly overlap those of the run, "
            f"{first:.6g} to {last:.6g} s, expected {FEWEST} samples or more in common; put the sensor on the clock of "
            'the drive (clock = "free" allows an offset of a quarter of a second only)'
        )
    return sensor.selected(inside, "they are outside of the run")


def third_differences(sensor: Sensor) -> FloatArray:
    """Return the third differences (k, c) of samples in a row, over sqrt(20): white noise leaves its sigma in them."""
    even = np.abs(np.diff(sensor.time) / sensor.step - 1.0) < 0.5
    in_a_row = even[:-2] & even[1:-1] & even[2:]
    return np.asarray(np.diff(sensor.values, n=3, axis=0)[in_a_row] / np.sqrt(20.0))


def smallest_sigma(sensors: Sequence[Sensor], share: float) -> FloatArray:
    """Return the smallest sigma (c,) that is believed of a sensor that states none: a share of its range.

    That is the largest range of any run, less its straight line: a fish swims far, and a track is no less exact for it.
    """
    reach = np.max([np.ptp(signal.detrend(sensor.values, axis=0), axis=0) for sensor in sensors], axis=0)
    return np.asarray(share * reach + 1e-9)


def first_sensor_sigma(sensors: Sequence[Sensor], share: float) -> FloatArray:
    """Return a first sigma (c,) of one sensor on several runs, not below `smallest_sigma`.

    It is that of the third differences, as for velocities; what is left of a smooth motion in them makes it larger.
    """
    least, differences = smallest_sigma(sensors, share), np.concatenate([third_differences(s) for s in sensors])
    return np.maximum(np.sqrt(np.mean(differences**2, axis=0)), least) if len(differences) else least
