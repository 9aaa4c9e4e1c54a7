"""Noise of what sensors read, once a model has been fitted: sizes that nobody states, and errors of measured joints.

Commanded angles have errors, too: what the joints did between two samples is known as well as it is smooth.

The size is that of the third differences of what the fit leaves (`mjfish.data.sensor.third_differences`). A misfit that
goes on from sample to sample hardly shows in them: no model can buy itself a noise.

**Joints.** Errors of measured joint angles are a noise of what sensors read: the fish is in the loop of the joints'
smoother. The angle of a joint is a twice
integrated white acceleration of intensity q, measured with white noise of sigma: the prior of the smoothing spline that
the rollout goes by (`mjfish.drive.measured`), with lam = sigma^2 / q. Its error d = (d, d', d'') around that spline is
then a Gauss-Markov process ([Wahba1990], ch. 1.5; [Rauch1965]),

    d_{k+1} = F~ d_k + w,   F~ = (1 + Q L_{k+1})^-1 F,   cov w = (1 + Q L_{k+1})^-1 Q,
    L_k = F' L_{k+1} F~ + m_k e e' / sigma^2

with F, Q of the prior, L the information that later samples have, and m_k whether k is one. It begins with
cov d_0 = L_0^-1. Through the equation of motion, linearised along the rollout, it moves the head:

    dv' = A dv + B (d, d', d''),   d(x, y)' = R(yaw) (dv + dyaw x v),   dyaw' = dw

Both together are the state of a Kalman filter (`mjfish.noise.kalman`) whose innovations are white: exact, and linear in
the number of samples.

[Rauch1965] H. Rauch, F. Tung and C. Striebel, AIAA Journal 3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import linalg

from mjfish.data import Sensor, Trial
from mjfish.data.sensor import smallest_sigma, third_differences
from mjfish.drive.measured import Smoothed
from mjfish.estimation.problem import Problem
from mjfish.model.model import Prepared, recorded_joints
from mjfish.model.sensing import Camera, Moments
from mjfish.noise.kalman import Gains, Sparse, add_row, advance, filtered_states, variances, whitened
from mjfish.numerics.arrays import BoolArray, FloatArray, blocks_of
from mjfish.numerics.block_angular import IntArray
from mjfish.numerics.compiled import compiled, part
from mjfish.ode.jacobians import jacobians
from mjfish.ode.rollout import Rollout

#: States of the head: surge, sway, yaw rate, x, y, yaw; and of a joint.
HEAD, JOINT = 6, 3
#: Longest step by which the disturbed head is integrated [s].
_LONGEST_STEP = 0.01
#: Times closer than this are one [s].
_SAME = 1e-9
#: Samples whose matrices are held at once: 21 MB of four joints.
_STRETCH = 4096
#: How gains and transitions are kept: to seven digits, which is six more than a model of noise has.
_KEPT: Any = np.float32
#: Coefficients of the quintics by powers of the share of the step.
_QUINTIC = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
    ]
)
#: The same of their values, rates and accelerations.
_BASIS = np.stack([np.pad(np.polynomial.polynomial.polyder(_QUINTIC, k, axis=1), ((0, 0), (0, k))) for k in range(3)])


@dataclass(frozen=True, eq=False)
class Along:
    """A rollout, linearised at the starts of its steps.

    Attributes:
        time: (n,) [s].
        state: (n, 6) surge, sway [m/s], yaw rate [rad/s], x, y [m], yaw [rad].
        jacobians: A (k, 3, 3) and B (k, 3, 3, joints) of a stretch of steps; the last but one axis of B: by angle, rate
            and acceleration.
    """

    time: FloatArray
    state: FloatArray
    jacobians: Callable[[slice], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class JointErrors:
    """The errors of the joint angles of one trial, and of the head that they move.

    The state (d,) has the six numbers of the head first, then three of every joint.

    Attributes:
        time: (n,) of all samples of joints and sensors, each once [s].
        intensity: (joints, n - 1) q until the next time, for times in units of `unit`.
        information: (joints, n, 3, 3) L of every joint, likewise: all numbers are of one size then.
        unit: the median step [s].
        start: (d, d) covariance of the state at the first time.
        along: the rollout.
    """

    time: FloatArray
    intensity: FloatArray
    information: FloatArray
    unit: float
    start: FloatArray
    along: Along

    @classmethod
    def of(cls, trial: Trial, joints: Sequence[Smoothed], along: Along) -> JointErrors:
        """Return the errors of a trial with measured joint angles.

        Args:
            trial: gives the times of its joints and sensors.
            joints: the smoothed angles.
            along: the rollout.
        """
        every = np.concatenate([trial.time, *(sensor.time for sensor in trial.sensors)])
        time = np.unique(np.maximum(every, trial.time[0]))
        time = time[np.concatenate([[True], np.diff(time) > _SAME])]
        measured = np.zeros(len(time), dtype=np.bool_)
        measured[np.searchsorted(time, trial.time - _SAME)] = True
        unit = float(np.median(np.diff(time)))
        scale = unit ** -np.arange(3.0)
        sigma = np.array([joint.sigma for joint in joints])
        at = np.minimum(np.searchsorted(trial.time, time[1:] - _SAME), len(trial.time) - 1) - 1
        intensity = np.stack([joint.intensity[at] for joint in joints]) * unit**5
        information = _information(np.diff(time) / unit, measured, sigma, intensity)
        begin = np.linalg.inv(information[:, 0]) * (scale[:, None] * scale)
        return cls(time, intensity, information, unit, linalg.block_diag(np.zeros((HEAD, HEAD)), *begin), along)

    def stretches(self) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield stretches of times, the transitions (k, d, d) to the next time, covariances (k, d, d) of what comes in.

        Those of the last time are 0.
        """
        size, along, scale = len(self.start), self.along, self.unit ** -np.arange(3.0)
        for first in range(0, len(self.time), _STRETCH):
            here = slice(first, min(first + _STRETCH, len(self.time)))
            moved = np.zeros((here.stop - first, HEAD, HEAD + 2 * (size - HEAD)))
            times = self.time[first : here.stop + 1]
            begin, end = np.searchsorted(along.time, times[[0, -1]]) + np.array([-1, 2])
            steps = slice(min(max(begin, 0), len(along.time) - 2), end)
            _move(times, along.time[steps], along.state[steps], *along.jacobians(steps), moved)
            transition, drive = np.zeros((2, len(moved), size, size))
            transition[:, :HEAD, :HEAD] = moved[:, :, :HEAD]
            later = self.information[:, first + 1 : here.stop + 1]
            forward, driven = _prior(np.diff(times) / self.unit)
            to = slice(len(forward))
            for j, intensity in enumerate(self.intensity):
                at = slice(HEAD + JOINT * j, HEAD + JOINT * (j + 1))
                left, right = (moved[to, :, HEAD + JOINT * (2 * j + k) :][:, :, :JOINT] for k in (0, 1))
                q = intensity[first : first + len(driven), None, None] * driven
                shrink = np.linalg.inv(np.eye(JOINT) + q @ later[j])
                transition[to, at, at] = own = shrink @ forward * (scale[:, None] / scale)
                transition[to, :HEAD, at] = left + right @ own
                drive[to, at, at] = push = shrink @ q * (scale[:, None] * scale)
                drive[to, :HEAD, at] = right @ push
                drive[to, at, :HEAD] = drive[to, :HEAD, at].transpose(0, 2, 1)
                drive[to, :HEAD, :HEAD] += drive[to, :HEAD, at] @ right.transpose(0, 2, 1)
            yield here, transition, drive

    def filter(self, reading: Sparse, sigma: FloatArray, counted: BoolArray) -> tuple[Gains, FloatArray]:
        """Return the filter of the channels of all sensors, and the variances (n, m) of what they read by errors alone.

        Args:
            reading: (m, d) derivatives of what the sensors read by the state at every time, see `stacked`.
            sigma: (m,) of one sample.
            counted: (n, m) which samples there are.
        """
        (n, m), d = counted.shape, len(self.start)
        spread = np.where(counted, sigma**2, 1.0)
        used = reading._replace(value=reading.value * counted[:, reading.row])  # what is missing tells nothing
        gain, scale, covariance = np.zeros((n, d, m), _KEPT), np.zeros((n, m)), self.start.copy()
        alone, unmeasured = np.zeros((n, m)), self.start.copy()
        row, column = Sparse.places(self._moving())
        moves = Sparse(row, column, np.zeros((n, len(row)), _KEPT), (d, d))
        for here, transition, drive in self.stretches():
            exact, seen = moves._replace(value=transition[:, row, column]), np.ones(len(drive), dtype=np.bool_)
            moves.value[here] = exact.value
            advance(exact, drive, used.part(here), spread[here], covariance, seen, gain[here], scale[here])
            variances(exact, drive, unmeasured, reading.part(here), alone[here])
        return Gains(moves, reading, gain, scale), alone

    def _moving(self) -> BoolArray:
        """Return where transitions (d, d) may not be zero."""
        moving = np.kron(np.eye(len(self.start) // JOINT), np.ones((JOINT, JOINT))) > 0.0
        moving[:HEAD, :3] = moving[:HEAD, HEAD:] = True
        moving[3:HEAD, 3:5] = np.eye(3, 2) > 0.0  # where the head is moves nothing
        return moving

    def stacked(self, rows: Sequence[FloatArray], readings: Sequence[FloatArray]) -> Sparse:
        """Return the derivatives (m, d) of the channels of all sensors at every time; 0 where a sensor has no sample.

        Args:
            rows: places in `time` of the samples of each sensor.
            readings: (samples, c, d) derivatives of what each sensor reads by the state.
        """
        there = np.concatenate([np.any(read != 0.0, axis=0) for read in readings])
        row, column = Sparse.places(there)
        value = np.zeros((len(self.time), len(row)))
        for at, read, own in zip(rows, readings, blocks_of([read.shape[1] for read in readings]), strict=True):
            mine = np.flatnonzero((row >= own.start) & (row < own.stop))
            value[at[:, None], mine] = read[:, row[mine] - own.start, column[mine]]
        return Sparse(row, column, value, there.shape)


def _information(steps: FloatArray, measured: BoolArray, sigma: FloatArray, intensity: FloatArray) -> FloatArray:
    """Return L (joints, n, 3, 3) of steps (n - 1,) and q (joints, n - 1); `measured` (n,): where angles are data."""
    found = np.zeros((len(sigma), len(measured), JOINT, JOINT))
    found[:, :, 0, 0] = measured / sigma[:, None] ** 2
    forward, driven = _prior(steps)
    for k in range(len(steps) - 1, -1, -1):
        own = np.linalg.inv(np.eye(JOINT) + intensity[:, k, None, None] * driven[k] @ found[:, k + 1]) @ forward[k]
        back = forward[k].T @ found[:, k + 1] @ own
        found[:, k] += 0.5 * (back + back.transpose(0, 2, 1))
    return found


def _prior(h: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F and Q / q of the prior (n, 3, 3) over steps (n,)."""
    one, zero = np.ones_like(h), np.zeros_like(h)
    forward = np.array([[one, h, 0.5 * h * h], [zero, one, h], [zero, zero, one]])
    driven = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    return np.moveaxis(forward, (0, 1), (-2, -1)), np.moveaxis(driven, (0, 1), (-2, -1))


@compiled
def _move(
    time: FloatArray, grid: FloatArray, state: FloatArray, by_state: FloatArray, by_input: FloatArray, out: FloatArray
) -> None:
    """Write how the head (n, 6, 6 + 6 joints) at the next time depends on what is now, by Runge-Kutta steps.

    Columns: of the head; then of every joint its (d, d', d'') now and at the next time, between which d is a quintic.
    """
    joints = by_input.shape[3]
    width = 6 + 6 * joints
    at = 0
    x, k, sum_k, there = np.zeros((6, width)), np.zeros((6, width)), np.zeros((6, width)), np.zeros((6, width))
    basis, b, head = np.zeros((3, 6)), np.zeros((3, 3, joints)), np.zeros(6)
    rates = np.zeros((6, 6))  # of the head by the head
    rates[5, 2] = 1.0
    for i in range(time.shape[0] - 1):
        w = time[i + 1] - time[i]
        parts = max(int(np.ceil(w / _LONGEST_STEP)), 1)
        h = w / parts
        x[:] = 0.0
        for r in range(6):
            x[r, r] = 1.0
        for piece in range(parts):
            there[:] = x
            sum_k[:] = 0.0
            for stage in range(4):
                ahead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                now = time[i] + piece * h + ahead
                while at < grid.shape[0] - 2 and grid[at + 1] <= now:
                    at += 1
                while at > 0 and grid[at] > now:
                    at -= 1
                share = min(max((now - grid[at]) / (grid[at + 1] - grid[at]), 0.0), 1.0)
                rates[:3, :3] = (1.0 - share) * by_state[at] + share * by_state[at + 1]
                b[:] = (1.0 - share) * by_input[at] + share * by_input[at + 1]
                head[:] = (1.0 - share) * state[at] + share * state[at + 1]
                surge, sway, cos, sin = head[0], head[1], np.cos(head[5]), np.sin(head[5])
                rates[3, 0], rates[3, 1], rates[3, 5] = cos, -sin, -(sin * surge + cos * sway)
                rates[4, 0], rates[4, 1], rates[4, 5] = sin, cos, cos * surge - sin * sway
                _quintic((piece * h + ahead) / w, w, basis)
                k[:] = 0.0
                for r in range(6):
                    for c in range(6):
                        add_row(k, r, there, c, rates[r, c])
                for j in range(joints):
                    for c in range(6):
                        for r in range(3):
                            for order in range(3):
                                k[r, 6 + 6 * j + c] += b[r, order, j] * basis[order, c]
                weight = 1.0 if stage == 0 or stage == 3 else 2.0
                step = 0.5 * h if stage < 2 else h
                sum_k += weight * k
                there[:] = x + step * k
            x += h / 6.0 * sum_k
        out[i] = x


@part
def _quintic(s: float, w: float, out: FloatArray) -> None:
    """Write value, rate and acceleration of the quintics (3, 6) of unit value, rate, acceleration at 0, then at w."""
    for c in range(6):
        for order in range(3):
            value = 0.0
            for power in range(5, -1, -1):
                value = value * s + _BASIS[order, c, power]
            out[order, c] = value * w ** (c % 3 - order)


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
