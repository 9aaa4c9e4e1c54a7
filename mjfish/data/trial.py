"""A `Trial` is one recording of measured swimming, a `Dataset` a folder of them with the fish they belong to.

What is known of the errors of a smoothed record are modes that are independent of each other:

    (velocity, joint angles)(t) = truth + sum_m a_m e_m(t),   a_m ~ N(0, 1)

The modes e_m are a root of the errors' covariance, cov = sum_m e_m e_m'. A table of them has the columns ``mode [-]``,
counted from 1, ``time [s]`` as in the trial, the three velocities and the joints; the rows of a mode follow each other.

Velocities may have been smoothed, or made by differentiating positions: the prediction goes through the same filter. A
Savitzky-Golay derivative [Savitzky1964] smooths the motion as it smooths the noise. A simulation that is compared with
such velocities must be smoothed alike, or what the filter took looks like an effect. The data are never filtered: that
takes their noise, and any model gains [Ljung1999, ch. 14].

[Savitzky1964] A. Savitzky, M. Golay, Analytical Chemistry 36. [Ljung1999] L. Ljung, System Identification: Theory for
the User, 2nd ed. [VanCittert1931] P. van Cittert, Zeitschrift fuer Physik 69.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, ndimage, signal

from mjfish.data import columns
from mjfish.data.sensor import Sensor
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.measured import smoothing_spline
from mjfish.drive.wave import Wave
from mjfish.errors import InputError, UnknownNameError
from mjfish.errors.arguments import check
from mjfish.files.plain_data import unsaved
from mjfish.files.result import reporting
from mjfish.fish import Fish, frames
from mjfish.fish.frames import CHANNELS
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly

#: Rounds of the iteration that undoes the smoothing of a heading [VanCittert1931].
_ROUNDS = 5


@dataclass(frozen=True)
class Differentiator:
    """A Savitzky-Golay derivative of positions.

    Attributes:
        window: samples; 3 of degree 2 are central differences.
        degree: of the polynomial.
        turned: whether positions were differentiated along the axes of the tank and turned into the fish's by a heading
            that was not smoothed; else as if along its own.
    """

    window: int
    degree: int
    turned: bool = False

    def of_trial(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Return the columns (n, 3, ...) of velocities of a trial, one row a sample, as this filter would make them."""
        if not self.turned:
            return self._filtered(trial, block)
        recorded = np.asarray(interpolate.CubicSpline(trial.time, trial.velocity[:, 2]).antiderivative()(trial.time))
        heading = recorded
        for _ in range(_ROUNDS):  # the recorded one comes of a rate that was smoothed
            heading = heading + recorded - self._filtered(trial, heading)
        return _turned(self._filtered(trial, _turned(block, heading)), -heading)

    def reach(self, step: float) -> float:
        """Return how far [s] a sample is felt to either side, samples being `step` [s] apart."""
        return 0.5 * self.window * step

    @property
    def words(self) -> str:
        """The filter in words."""
        along = "the tank" if self.turned else "the fish"
        return f"positions along the axes of {along}, differentiated over {self.window} samples, degree {self.degree}"

    def _filtered(self, trial: Trial, columns: FloatArray) -> FloatArray:
        """Integrate columns (n, ...) to positions, at missing samples, too, and differentiate these by the filter."""
        rows = trial.rows
        flat, grid = columns.reshape(len(columns), -1), np.interp(np.arange(rows[-1] + 1), rows, trial.time)
        path = interpolate.CubicSpline(trial.time, flat).antiderivative()(grid)
        smooth = signal.savgol_filter(path, self.window, self.degree, deriv=1, delta=trial.step, axis=0)
        return np.asarray(smooth[rows].reshape(columns.shape))


#: Standard deviations beyond which a Gaussian is cut.
_CUT = 3.0


@dataclass(frozen=True)
class GaussianFilter:
    """A Gaussian that velocities were smoothed with.

    Attributes:
        sd: of it [s]. A wave of frequency f keeps exp(-(2 pi f sd)^2 / 2) of its amplitude.
    """

    sd: float

    def of_trial(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Return the columns (n, 3, ...) of velocities of a trial, one row a sample, as this filter would make them."""
        rows, flat = trial.rows, block.reshape(len(block), -1)
        grid = np.interp(np.arange(rows[-1] + 1), rows, trial.time)
        dense = flat if len(grid) == len(flat) else interpolate.CubicSpline(trial.time, flat)(grid)
        smooth = ndimage.gaussian_filter1d(dense, self.sd / trial.step, axis=0, mode="nearest", truncate=_CUT)
        return np.asarray(smooth[rows].reshape(block.shape))

    def reach(self, step: float) -> float:
        """Return how far [s] a sample is felt to either side, samples being `step` [s] apart."""
        return max(_CUT * self.sd, step)

    @property
    def words(self) -> str:
        """The filter in words."""
        return f"velocities smoothed by a Gaussian of {1e3 * self.sd:.3g} ms"


#: What recorded velocities went through.
Filter = Differentiator | GaussianFilter


def restored_filter(fields: Mapping[str, Any] | None) -> Filter | None:
    """Return the filter whose fields these are."""
    kind = GaussianFilter if fields and "sd" in fields else Differentiator
    return kind(**fields) if fields else None


def _turned(block: FloatArray, angle: FloatArray) -> FloatArray:
    """Turn the first two of three components (n, 3, ...) by angles (n,)."""
    angle = angle.reshape(-1, *[1] * (block.ndim - 2))
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * block[:, 0] - s * block[:, 1], s * block[:, 0] + c * block[:, 1], block[:, 2]], axis=1)


Role = Literal["fit", "held_out"]
Clock = Literal["synchronised", "free"]
Hold = Literal["zero", "linear"]
#: Trials that the text of a dataset lists.
_TRIALS_SHOWN = 8


def rows_of(time: FloatArray) -> NDArray[np.intp]:
    """Return the row (n,) of every sample on a grid of equal steps: rows of lost samples are skipped.

    Step by step, for times that are rounded or jitter drift against any even grid; no two samples share a row.

    Args:
        time: (n,) increasing [s].
    """
    steps = np.diff(time)
    apart = np.maximum(np.rint(steps / np.median(steps)), 1.0) if len(steps) else steps
    return np.concatenate([np.zeros(1, dtype=np.intp), np.cumsum(apart.astype(np.intp))])


def seen_of(rows: NDArray[np.intp]) -> BoolArray:
    """Return, on the grid of equal steps up to the last of `rows` (n,), which rows are there."""
    return np.asarray(np.bincount(rows) > 0)


@dataclass(frozen=True)
class Tank:
    """Where the walls of the tank are.

    Attributes:
        x, y: lowest and highest coordinate [m], in the world of the poses.
    """

    x: tuple[float, float]
    y: tuple[float, float]

    def distance(self, pose: FloatArray) -> FloatArray:
        """Return the distances (n,) [m] of places (n, 2 or more) to the nearest wall, negative outside."""
        low, high = np.transpose((self.x, self.y))
        return np.asarray(np.minimum(pose[:, :2] - low, high - pose[:, :2]).min(axis=1))


@dataclass(frozen=True, eq=False)
class Trial:
    """One recording of a swimming fish, validated.

    Attributes:
        name: of the trial.
        role: ``fit``, ``held_out``, or None where the dataset assigns none.
        time: (n,) increasing [s].
        velocity: (n, 3) surge [m/s], sway [m/s], yaw rate [rad/s] of the nose in the forward frame; NaN in the channels
            that were not `measured`.
        drive: CPG segments; empty where the joints were measured.
        joint_angle: (n, joints) measured joint angles [rad], or None.
        commanded: the angles are those that the servos were told, with a `hold` between them; else those of the joints.
        hold: what a commanded angle does until the next one: ``zero``, it stays; ``linear``, it goes there smoothly.
        from_rest: the fish is known to be at rest in the water at the first sample, though no CPG drives it.
        pose: (n, 3) x [m], y [m], yaw [rad] in the world, or None; yaw alone may be given (x, y are NaN then).
        roll: (n,) [rad], or None.
        source: the file it was read from.
        gaps: samples are missing, and known to be: times may have gaps.
        wave: the wave that drives the joints, or None.
        tank: its walls, or None where they are not known.
        errors: (modes, n, 3 + joints) what is known of the errors of `velocity` and `joint_angle`: their sum, each mode
            times an independent standard normal number (`mjfish.data.trial`); None: not known.
        sensors: what else was measured, each on its own clock.
        walk: sizes of the modes of the walk of the drive's clock [s^0.5] (`mjfish.drive.walk`); none: it does not walk.

    Example:
        >>> import mjfish
        >>> (trial,) = mjfish.generate("pike", ["v1"], duration=2.0).trials
        >>> trial.velocity.shape, round(trial.step, 3)
        ((101, 3), 0.02)
    """

    name: str
    role: Role | None
    time: FloatArray
    velocity: FloatArray
    drive: tuple[DriveSegment, ...] = ()
    joint_angle: FloatArray | None = unsaved(default=None)
    pose: FloatArray | None = unsaved(default=None)
    roll: FloatArray | None = unsaved(default=None)
    source: Path | None = unsaved(default=None)
    gaps: bool = unsaved(default=False)
    wave: Wave | None = unsaved(default=None)
    tank: Tank | None = unsaved(default=None)
    errors: FloatArray | None = unsaved(default=None)
    commanded: bool = unsaved(default=False)
    hold: Hold = unsaved(default="linear")
    from_rest: bool = unsaved(default=False)
    sensors: tuple[Sensor, ...] = unsaved(default=())
    walk: tuple[float, ...] = unsaved(default=())

    def __repr__(self) -> str:
        """Return one line: name, role, samples, duration, rate and what moves the joints."""
        sampling = f"{len(self.time)} samples"
        if len(self.time) > 1:
            sampling += f" in {float(np.ptp(self.time)):.4g} s ({1.0 / self.step:.4g} Hz)"
        beside = f", with {', '.join(sensor.name for sensor in self.sensors)}" if self.sensors else ""
        role = self.role or "not assigned"
        return f"<Trial '{self.name}', role {role}: {sampling}{beside}, driven by {self.driven_by}>"

    @property
    def driven_by(self) -> str:
        """What moves the joints, in words."""
        recorded = "recorded commands" if self.commanded else "measured joint angles"
        return "a wave" if self.wave is not None else "the CPG" if self.drive else recorded

    @property
    def joints_measured(self) -> bool:
        """Whether the angles of the joints were measured: no servo stands between them and the model.

        Sensors of their own measured them where the trial has no `errors`: angles of tracks come with these.
        """
        return self.joint_angle is not None and not self.commanded

    @cached_property
    def measured(self) -> BoolArray:
        """Which of surge, sway and yaw rate (3,) were measured."""
        return np.asarray(~np.all(np.isnan(self.velocity), axis=0))

    @cached_property
    def step(self) -> float:
        """Step between samples [s]: the median, for gaps may be among them."""
        return float(np.median(np.diff(self.time)))

    @property
    def rate(self) -> float:
        """Samples a second [Hz], by the whole run: single times may be rounded."""
        return float(self.rows[-1] / (self.time[-1] - self.time[0]))

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Row (n,) of every sample on a grid of equal steps, see `rows_of`."""
        return rows_of(self.time)

    @property
    def starts_at_rest(self) -> bool:
        """Whether the trial begins with the fish at rest in the water, as every CPG-driven trial does, at time 0.

        A wave starts it from rest where it has a ramp; measured or commanded angles do where the dataset says so.
        """
        return self.from_rest or (self.joint_angle is None and (self.wave is None or self.wave.ramp > 0.0))

    @property
    def first_velocity(self) -> FloatArray:
        """Velocity (3,) at the first sample: zero at rest, else as measured, NaN where it was not."""
        return np.zeros(len(CHANNELS)) if self.starts_at_rest else self.velocity[0]

    @property
    def free_start(self) -> bool:
        """Whether the velocity at the start is fitted: of a trial that is under way, or whose joints were measured.

        The rate of a measured joint has a large error at the first sample, for no earlier one helps to smooth it. A
        simulated fish whose joints begin with that rate and whose head begins at rest has a momentum that the real one
        has not.
        """
        return not self.starts_at_rest or self.joints_measured

    @property
    def level_walk(self) -> bool:
        """Whether phase and frequency of the drive are known of the whole run, so that its walk has no trend."""
        return self.wave is not None and self.wave.free

    def waved(self, frequency: float, phase: float, scale: float = 1.0) -> Trial:
        """Return the trial with another wave.

        Args:
            frequency: by which it is higher [Hz].
            phase: by which it is higher in the middle of the record [rad].
            scale: of its angles.
        """
        if self.wave is None:
            return self
        phase -= 2.0 * math.pi * frequency * (0.5 * float(self.time[0] + self.time[-1]))
        return replace(self, wave=self.wave.moved(frequency=frequency, phase=phase, scale=scale))


@dataclass(frozen=True, eq=False)
class Dataset:
    """Trials of one fish.

    Attributes:
        name: of the dataset.
        fish: with the start values and bounds of the dataset's ``[start]`` table applied.
        trials: in the order of the file.
        noise: (3,) sigma of the measured surge [m/s], sway [m/s], yaw rate [rad/s], NaN of one that no trial measured;
            None: estimate it from the data.
        clock: ``synchronised``, or ``free`` where the velocity clock has an unknown offset in each trial.
        source: the dataset.toml it was read from.
        known: what is known of numbers that are no part of the fish, by name or pattern (see
            `mjfish.fish.parameter_priors.ParameterPrior`): ``wave.scale``, ``*:wave.frequency``, ``run_1:start.surge``,
            or a cause's, which makes it a part of the nominal model.
        filter: that the recorded velocities went through, and predictions do, too; None: none is known.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate("pike", ["v1", "v3"], held_out=["v3"], duration=2.0)
        >>> fitted, held_out = pool.split()
        >>> [trial.name for trial in held_out]
        ['v3']
        >>> pool["v1"].driven_by
        'the CPG'
    """

    name: str
    fish: Fish
    trials: tuple[Trial, ...]
    noise: FloatArray | None = None
    clock: Clock = "synchronised"
    source: Path | None = None
    known: Mapping[str, ParameterPrior] = field(default_factory=dict)
    filter: Filter | None = None

    def __post_init__(self) -> None:
        """Refuse what is no fish and no trials, and velocities that are not three for every time."""
        check("Dataset: fish", self.fish, Fish)
        check("Dataset: trials", self.trials, tuple[Trial, ...])
        for trial in self.trials:
            check(f"trial '{trial.name}': velocity", trial.velocity, FloatArray)
            if trial.velocity.shape != (len(trial.time), 3):
                raise InputError(
                    f"trial '{trial.name}': surge, sway, yaw_rate have shape {trial.velocity.shape}, expected "
                    f"{(len(trial.time), 3)}: a row for every time and a column for each; correct it"
                )

    def __getitem__(self, name: str) -> Trial:
        """Return the trial of this name.

        Raises:
            UnknownNameError: there is none; the message has the names that there are, and those that are similar.
        """
        found = {trial.name: trial for trial in self.trials}
        if not isinstance(name, str) or name not in found:
            near = difflib.get_close_matches(str(name), found)
            raise UnknownNameError("trial", name, found, f"did you mean {' or '.join(near)}?" if near else "")
        return found[name]

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def plot(self) -> Any:
        """Return the velocities of every trial over time, as a ``plotly.graph_objects.Figure``.

        Of places and headings, those of the smoothed path.
        """
        return reporting().figure(self)

    def summary(self) -> str:
        """Return at most ten lines: fish, stated noise, clock and the first trials."""
        sigmas = [np.nan] * 3 if self.noise is None else self.noise
        named = zip(("surge", "sway", "yaw rate"), sigmas, ("m/s", "m/s", "rad/s"), strict=True)
        noise = ", ".join(f"{name} {sigma:.3g} {unit}" for name, sigma, unit in named if sigma == sigma)
        shown = self.trials if len(self.trials) <= _TRIALS_SHOWN else self.trials[: _TRIALS_SHOWN - 1]
        more = len(self.trials) - len(shown)
        return "\n".join(
            [
                f"Dataset '{self.name}': fish '{self.fish.name}', {len(self.trials)} trials, clock {self.clock}",
                f"  noise: {noise or 'not stated'}",
                *(f"  {trial!r}" for trial in shown),
                *([f"  and {more} more trials"] if more else []),
            ]
        )

    def split(self) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
        """Return the trials to fit and the trials held out.

        Where any trial has a role, those without one are fitted. Where none has, every third trial is held out,
        beginning with the second: spread over the list, at least one of two, and never the first.

        Raises:
            InputError: there is none to fit.
        """
        any_role = any(trial.role is not None for trial in self.trials)
        held = [trial.role == "held_out" if any_role else index % 3 == 1 for index, trial in enumerate(self.trials)]
        if all(held):
            raise InputError(f"{self.name}: no trial to fit, expected one or more; add one, or hold out fewer")
        pairs = list(zip(self.trials, held, strict=True))
        return tuple(trial for trial, out in pairs if not out), tuple(trial for trial, out in pairs if out)


#: Said where such velocities are shown.
SMOOTHED = "measured velocities are those of the smoothed path: for looking, nothing was fitted to them"


@lru_cache(maxsize=256)
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


#: Share of the variance of the errors that modes may leave out.
_LEFT_OUT = 1e-3


def principal_modes(root: FloatArray) -> FloatArray:
    """Return the principal modes (modes, n, series) of errors, without those that hold a thousandth of the variance.

    Args:
        root: (series, n, k), whose square root root' is the covariance; every series counts by its own mean variance.
    """
    series, samples, _ = root.shape
    scale = np.sqrt(np.square(root).sum(axis=2).mean(axis=1))[:, None, None]
    flat = (root / np.maximum(scale, 1e-300)).reshape(series * samples, -1)
    vectors, values, _ = np.linalg.svd(flat, full_matrices=False)
    share = np.cumsum(values**2) / max(float(np.sum(values**2)), 1e-300)
    kept = slice(int(np.searchsorted(share, 1.0 - _LEFT_OUT)) + 1)
    return np.asarray(((vectors[:, kept] * values[kept]).reshape(series, samples, -1) * scale).transpose(2, 1, 0))


def errors_to_columns(trial: Trial) -> dict[str, FloatArray]:
    """Return the modes of a trial as columns by name.

    Raises:
        InputError: they do not have its samples, velocities and joints.
    """
    modes, names = np.asarray(trial.errors), _error_columns(trial)
    expected = (len(trial.time), len(names) - 2)
    if modes.shape[1:] != expected:
        raise InputError(
            f"trial '{trial.name}': errors have the last axes {modes.shape[1:]}, expected {expected}: a row for every "
            "time, the three velocities and the joints; correct them"
        )
    number = np.repeat(np.arange(1.0, len(modes) + 1.0), len(trial.time))
    return dict(zip(names, [number, np.tile(trial.time, len(modes)), *modes.reshape(-1, expected[1]).T], strict=True))


def errors_from_columns(numbers: Mapping[str, FloatArray], trial: Trial, source: Path) -> FloatArray:
    """Return the modes (modes, n, 3 + joints) of a table: surge, sway [m/s], yaw rate [rad/s], joints [rad].

    Raises:
        InputError: rows or columns are not those of the trial.
    """
    names = _error_columns(trial)
    if list(numbers) != names:
        found, expected = (", ".join(map(columns.header, which)) for which in (numbers, names))
        raise InputError(f"{source}: columns {found}, expected {expected}; write them so")
    count, rest = divmod(len(numbers["mode"]), len(trial.time))
    there = np.stack([numbers["mode"], numbers["time"]], axis=1)
    wanted = np.stack([np.repeat(np.arange(1.0, count + 1.0), len(trial.time)), np.tile(trial.time, count)], axis=1)
    if rest or not np.array_equal(there, wanted):
        raise InputError(
            f"{source}: expected the modes 1, 2, ... one after another, each with the {len(trial.time)} times of "
            f"trial '{trial.name}'; write them so, or remove 'errors' from its entry"
        )
    return readonly(np.stack([numbers[name] for name in names[2:]], axis=1).reshape(count, len(trial.time), -1))


def _error_columns(trial: Trial) -> list[str]:
    joints = 0 if trial.joint_angle is None else trial.joint_angle.shape[1]
    return ["mode", "time", *CHANNELS, *(columns.joint(i + 1) for i in range(joints))]
