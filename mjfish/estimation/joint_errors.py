"""Sensors of trials whose joint angles were measured, whitened with the errors of the angles (`mjfish.noise`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, blocks_of
from mjfish.data import Sensor, Trial
from mjfish.model.model import Prepared, recorded_joints
from mjfish.model.sensing import Camera, Moments, moments
from mjfish.noise.joint_errors import HEAD, JOINT, Along, JointErrors
from mjfish.noise.kalman import Gains, whitened
from mjfish.ode.jacobians import input_jacobian, state_jacobian
from mjfish.ode.rollout import Rollout

#: Steps of the differences of what a sensor reads, by states of the head and by angles.
_STEP = 1e-6
#: Errors of joint angles that move what a sensor reads by a smaller share of its sigma are left out.
_MATTERS = 0.1


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitens the counted samples of the sensors of a trial.

    Attributes:
        rows: places in the times of `filter` of the counted samples of each sensor.
        channels: places of its channels.
        filter: of the channels of all sensors.
    """

    rows: tuple[FloatArray, ...]
    channels: list[slice]
    filter: Gains

    def __call__(self, blocks: Sequence[FloatArray]) -> list[FloatArray]:
        """Return columns (m, c, k) of the counted samples of each sensor, in physical units, whitened."""
        every = np.zeros((len(self.filter.gain), self.channels[-1].stop, blocks[0].shape[2]))
        for at, own, block in zip(self.rows, self.channels, blocks, strict=True):
            every[at, own] = block
        white = whitened(self.filter, np.ones(len(every), dtype=np.bool_), every)
        return [white[at, own] for at, own in zip(self.rows, self.channels, strict=True)]


def whitening(
    trial: Trial, run: Prepared, rollout: Rollout, sigma: Sequence[FloatArray], masks: Sequence[BoolArray]
) -> Whitening | None:
    """Return what whitens the sensors of a trial whose joints were measured, linearised along a rollout.

    None where the errors of the joints move no reading by `_MATTERS` of its sigma, rms.

    Args:
        trial: the data.
        run: what was simulated.
        rollout: of it; it reached its end.
        sigma: (c,) of each sensor.
        masks: (m,) which of its samples count.
    """
    by_state, by_joints = (
        partial(of, run.fish, rollout, values=run.coefficients, loads=run.loads)
        for of in (state_jacobian, input_jacobian)
    )
    along = Along(
        rollout.time[:-1],
        rollout.state[:, 0, :HEAD].copy(),
        lambda steps: (by_state(steps=steps), by_joints(steps=steps)),
    )
    errors = JointErrors.of(trial, recorded_joints(trial), along)
    places = [np.searchsorted(errors.time, np.maximum(s.time, trial.time[0]) - 1e-9) for s in trial.sensors]
    readings = [_reading(trial, s, moments(run.fish, rollout, run.motion, s.time)) for s in trial.sensors]
    channels = blocks_of([len(sensor.channels) for sensor in trial.sensors])
    counted = np.zeros((len(errors.time), channels[-1].stop), dtype=np.bool_)
    rows = tuple(at[mask] for at, mask in zip(places, masks, strict=True))
    for at, own in zip(rows, channels, strict=True):
        counted[at, own] = True
    gains, variances = errors.filter(errors.stacked(places, readings), np.concatenate(sigma), counted)
    means = [np.mean(variances[at, own], axis=0) for at, own in zip(places, channels, strict=True)]
    matter = np.max(np.sqrt(np.concatenate(means)) / np.concatenate(sigma)) >= _MATTERS
    return Whitening(rows, channels, gains) if matter else None


def _reading(trial: Trial, sensor: Sensor, here: Moments) -> FloatArray:
    """Return the derivatives (m, c, d) of what a sensor reads, by the state of the head and of every joint."""
    joints, samples, camera = here.angle.shape[1], len(here.angle), Camera(trial)
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
