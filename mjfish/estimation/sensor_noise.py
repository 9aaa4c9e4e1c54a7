"""Noise of what sensors read, once a model has been fitted: sizes that nobody states, and errors of measured joints.

Commanded angles have errors, too: what the joints did between two samples is known as well as it is smooth.

The size is that of the third differences of what the fit leaves (`mjfish.data.sensor.third_differences`). A misfit that
goes on from sample to sample hardly shows in them: no model can buy itself a noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data import Sensor, Trial
from mjfish.data.sensor import smallest_sigma, third_differences
from mjfish.estimation.joint_errors import Whitening, whitening
from mjfish.estimation.problem import Problem

#: Smallest sigma that is believed, as a share of the range of a channel: samples are rounded.
_ROUNDED = 1e-5


@dataclass(frozen=True, eq=False)
class AlongFit:
    """Whitens trials linearised along the rollouts of a fit: one that was not fitted, from a guess of its start.

    Attributes:
        problem: that was fitted.
        values: of its parameters by name.
    """

    problem: Problem
    values: Mapping[str, float]
    _cache: dict[tuple[str | bytes, ...], Whitening | None] = field(default_factory=dict)

    def __call__(self, trial: Trial, sigma: Sequence[FloatArray], masks: Sequence[BoolArray]) -> Whitening | None:
        """Return what whitens a trial; None where its joints were not recorded, or their errors do not matter.

        Nor where it has velocities, whose noise allows for the errors by itself.
        """
        key: tuple[str | bytes, ...] = (
            trial.name,
            *(array.tobytes() for array in sigma),
            *(mask.tobytes() for mask in masks),
        )
        if key not in self._cache:
            allowed = trial.joint_angle is not None and bool(trial.sensors) and not trial.measured.any()
            self._cache[key] = self._whitening(trial, sigma, masks) if allowed else None
        return self._cache[key]

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process gets: filters are large, and made again."""
        return {**vars(self), "_cache": {}}

    def drop(self) -> None:
        """Let go of the memory of all trials, 0.8 kB a sample of four joints; what is asked for again is made again."""
        self._cache.clear()

    def _whitening(self, trial: Trial, sigma: Sequence[FloatArray], masks: Sequence[BoolArray]) -> Whitening | None:
        alone = replace(self.problem, trials=(trial,), joint_errors=None)
        values = alone.named(alone.start(self.values))
        predicted = alone.prediction(trial, values)
        if predicted.message:  # nothing is linear about a run that diverges
            return None
        left = [sensor.values - read for sensor, read in zip(trial.sensors, predicted.sensors, strict=True)]
        return whitening(trial, alone.model.prepare(trial, values), predicted.rollout, left, sigma, masks)


def with_sensor_noise(problem: Problem, x: FloatArray) -> Problem:
    """Return a problem with the noise of its sensors that a fit shows; the same one where it has none.

    Args:
        problem: that was fitted.
        x: estimates of its free parameters.
    """
    if not problem.sensors:
        return problem
    left: dict[str, list[FloatArray]] = {}
    for (_, sensor), predicted in zip(problem.sensors, problem.sensor_predictions(x), strict=True):
        if sensor.sigma is None:
            left.setdefault(sensor.name, []).append(_spread(sensor, predicted))
    sigma = {
        name: np.maximum(
            np.sqrt(np.mean(np.concatenate(rows), axis=0)),
            smallest_sigma([sensor for _, sensor in problem.sensors if sensor.name == name], _ROUNDED),
        )
        for name, rows in left.items()
    }
    if isinstance(problem.joint_errors, AlongFit):
        problem.joint_errors.drop()
    problem = replace(problem, sensor_sigma={**problem.sensor_sigma, **sigma}, joint_errors=None)
    exact = all(trial.joint_angle is None for trial in problem.trials)
    return problem if exact else replace(problem, joint_errors=AlongFit(problem, problem.named(x)))


def joints_in_words(problem: Problem) -> Iterator[str]:
    """Yield in which trials errors of recorded joint angles matter, and in which they do not."""
    told: dict[bool, list[str]] = {}
    for index, trial in enumerate(problem.trials):
        allowed = trial.joint_angle is not None and trial.sensors and not trial.measured.any()
        if allowed and problem.joint_errors is not None:
            told.setdefault(problem.errors_of_joints(index)[0] is not None, []).append(trial.name)
    for matter, names in told.items():
        what = "matter: they are counted as noise" if matter else "do not matter: the angles are taken as exact"
        yield f"errors of the recorded joint angles in {', '.join(names)} {what}"


def having_noise_of(problem: Problem, other: Problem) -> Problem:
    """Return a problem with the noise of another one, of velocities and of sensors."""
    return replace(problem, noise=other.noise, sensor_sigma=other.sensor_sigma, joint_errors=other.joint_errors)


def _spread(sensor: Sensor, predicted: FloatArray) -> FloatArray:
    """Return the squared third differences (k, c) of what is left of the samples of a sensor that were reached."""
    reached = np.isfinite(predicted).all(axis=1)
    return (
        third_differences(replace(sensor, time=sensor.time[reached], values=(sensor.values - predicted)[reached])) ** 2
    )
