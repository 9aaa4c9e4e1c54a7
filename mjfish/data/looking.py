"""Velocities for looking: where places and headings were measured, a smoothed path is differentiated for pictures.

Nothing is fitted to them, and no test rests on them.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from mjfish.data.sensor import Sensor
from mjfish.data.trial import Trial
from mjfish.drive.measured import smoothing_spline
from mjfish.fish import frames
from mjfish.numerics.arrays import FloatArray, readonly

#: Said where such velocities are shown.
SMOOTHED = "measured velocities are those of the smoothed path: for looking, nothing was fitted to them"


@functools.lru_cache(maxsize=256)
def for_looking(trial: Trial) -> Trial:
    """Return a trial with the velocities and poses of its smoothed path, where it has none but places and headings.

    A trial with velocities, or without a place and a heading of the head, is returned as it is.
    """
    seen = {sensor.kind: sensor for sensor in trial.sensors if sensor.link == 0}
    if trial.measured.any() or not {"position", "heading"} <= seen.keys():
        return trial
    x, y = (_smoothed(seen["position"], axis, trial.time) for axis in (0, 1))
    yaw = _smoothed(seen["heading"], 0, trial.time)
    ahead = seen["position"].station * np.stack([np.cos(yaw[0]), np.sin(yaw[0])], axis=1)
    swung = yaw[1][:, None] * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    place, rate = np.stack([x[0], y[0]], axis=1) + ahead, np.stack([x[1], y[1]], axis=1) + swung
    velocity = np.column_stack([frames.to_body(rate, yaw[0]), yaw[1]])
    return replace(trial, velocity=readonly(velocity), pose=readonly(np.column_stack([place, yaw[0]])))


def _smoothed(sensor: Sensor, column: int, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return one channel of a sensor and its rate (n,) at some times; at those outside of its own, that at its end."""
    spline = smoothing_spline(sensor.time, sensor.values[:, column])
    at = np.clip(time, sensor.time[0], sensor.time[-1])
    return np.asarray(spline(at)), np.asarray(spline(at, nu=1))
