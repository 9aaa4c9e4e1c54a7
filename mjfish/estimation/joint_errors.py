"""Sensors of trials whose joint angles were measured, whitened with the errors of the angles (`mjfish.noise`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, blocks_of
from mjfish.block_angular import IntArray
from mjfish.data import Sensor, Trial
from mjfish.model.model import Prepared, recorded_joints
from mjfish.model.sensing import Camera, Moments
from mjfish.noise.joint_errors import HEAD, JOINT, Along, JointErrors
from mjfish.noise.kalman import Gains, filtered_states, whitened
from mjfish.ode.jacobians import jacobians
from mjfish.ode.rollout import Rollout

#: Steps of the differences of what a sensor reads, by states of the head and by angles.
_STEP = 1e-6
#: Place of the heading in the state of the head.
_YAW = 5
#: Errors of joint angles that move what a sensor reads by a smaller share of its sigma are left out.
_MATTERS = 0.1


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitens the counted samples of the sensors of a trial.

    Attributes:
        places: places in the times of `filter` of all samples of each sensor.
        masks: (m,) which of them count.
        channels: places of its channels.
        filter: of the channels of all sensors.
    """

    places: Sequence[IntArray]
    masks: Sequence[BoolArray]
    channels: list[slice]
    filter: Gains

    def __call__(self, blocks: Sequence[FloatArray]) -> list[FloatArray]:
        """Return columns (m, c, k) of the counted samples of each sensor, in physical units, whitened."""
        rows = [at[mask] for at, mask in zip(self.places, self.masks, strict=True)]
        every = _side_by_side(len(self.filter.gain), rows, self.channels, blocks)
        white = whitened(self.filter, np.ones(len(every), dtype=np.bool_), every)
        return [white[at, own] for at, own in zip(rows, self.channels, strict=True)]

    def explained(self, left: Sequence[FloatArray]) -> list[FloatArray]:
        """Return by how much errors of the joints move all samples (m, c), by the counted ones of them and before.

        Args:
            left: (m, c) what a prediction leaves of each sensor.
        """
        series, read = _side_by_side(len(self.filter.gain), self.places, self.channels, left), self.filter.reading
        states, moved = filtered_states(self.filter, series), np.zeros_like(series)
        for place, (row, column) in enumerate(zip(read.row, read.column, strict=True)):
            moved[:, row] += read.value[:, place] * states[:, column]
        return [moved[at, own] for at, own in zip(self.places, self.channels, strict=True)]


def whitening(
    trial: Trial,
    run: Prepared,
    rollout: Rollout,
    left: Sequence[FloatArray],
    sigma: Sequence[FloatArray],
    masks: Sequence[BoolArray],
) -> Whitening | None:
    """Return what whitens the sensors of a trial whose joints were measured, linearised where the fish was.

    None where the errors of the joints move no reading by `_MATTERS` of its sigma, rms.

    An error of a joint turns the fish, and then moves it across its heading. A rollout may have another heading; a
    filter linearised along it leads the next fit further away. So the heading is estimated by that filter first, and
    the rollout is turned to it, as in an extended Kalman filter.

    Args:
        trial: the data.
        run: what was simulated.
        rollout: of it; it reached its end.
        left: (m, c) what it leaves of the samples of each sensor.
        sigma: (c,) of each sensor.
        masks: (m,) which of its samples count.
    """
    along = Along(
        rollout.time[:-1],
        rollout.state[:, 0, :HEAD].copy(),
        lambda steps: jacobians(run.fish, rollout, values=run.coefficients, loads=run.loads, steps=steps),
    )
    camera, errors = Camera(trial), JointErrors.of(trial, recorded_joints(trial), along)
    places = [np.searchsorted(errors.time, np.maximum(s.time, trial.time[0]) - 1e-9) for s in trial.sensors]
    channels = blocks_of([len(sensor.channels) for sensor in trial.sensors])
    series = _side_by_side(len(errors.time), places, channels, left)
    there = (mask[:, None] * np.ones_like(block) for mask, block in zip(masks, left, strict=True))
    counted = _side_by_side(len(errors.time), places, channels, [*there]) > 0.0

    def filtered(turned: FloatArray) -> tuple[Gains, FloatArray]:
        """Return the filter along the rollout turned by angles (n,) at the times of the errors, and variances."""
        state = along.state.copy()
        state[:, _YAW] += np.interp(along.time, errors.time, turned)
        here = replace(errors, along=replace(along, state=state))
        reading = here.stacked(
            places,
            [
                _reading(camera, sensor, camera.moments(run.fish, rollout, run.motion, sensor.time), turned[at])
                for sensor, at in zip(trial.sensors, places, strict=True)
            ],
        )
        return here.filter(reading, np.concatenate(sigma), counted)

    headed = filtered_states(filtered(np.zeros(len(errors.time)))[0], series)[:, _YAW].copy()  # not two filters at once
    gains, variances = filtered(headed)
    means = (np.mean(variances[at, own], axis=0) for at, own in zip(places, channels, strict=True))
    matter = np.concatenate([*means]) >= (_MATTERS * np.concatenate(sigma)) ** 2
    return Whitening(places, masks, channels, gains) if matter.any() else None


def _side_by_side(
    count: int, rows: Sequence[IntArray], channels: Sequence[slice], blocks: Sequence[FloatArray]
) -> FloatArray:
    """Return the blocks (m, c, ...) of all sensors in their channels of (count, channels, ...); 0 where none is."""
    every = np.zeros((count, channels[-1].stop, *blocks[0].shape[2:]))
    for at, own, block in zip(rows, channels, blocks, strict=True):
        every[at, own] = block
    return every


def _reading(camera: Camera, sensor: Sensor, here: Moments, turned: FloatArray) -> FloatArray:
    """Return the derivatives (m, c, d) of what a sensor reads, by the state of the head and of every joint.

    They are those of a fish that is turned on by angles (m,).
    """
    here = replace(here, state=here.state + turned[:, None] * np.eye(here.state.shape[1])[_YAW])
    joints, samples = here.angle.shape[1], len(here.angle)
    found = np.zeros((samples, len(sensor.channels), HEAD + JOINT * joints))
    for column in range(HEAD + joints):
        one = np.eye(HEAD + joints)[column]
        state, angle = np.zeros_like(here.state), np.tile(one[HEAD:], (samples, 1))
        state[:, :HEAD] = one[:HEAD]
        along = Moments(here.time, state, np.zeros_like(here.rate), angle, np.zeros_like(here.length))
        ahead, behind = (camera.read(sensor, here.moved(by, along)) for by in (_STEP, -_STEP))
        place = column if column < HEAD else HEAD + JOINT * (column - HEAD)
        found[:, :, place] = (ahead - behind) / (2.0 * _STEP)
    return found
