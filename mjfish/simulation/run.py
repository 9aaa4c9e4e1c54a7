"""One simulated run of a fish with its effects, in either engine, as a camera would measure it; and bands of runs."""

from __future__ import annotations

import math
import tomllib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from mjfish import mujoco, ode
from mjfish.data import Trial, columns, read_table, validation, write_table
from mjfish.data.dataset_toml import Law
from mjfish.drive import modes
from mjfish.drive.motion import JointMotion
from mjfish.drive.wave import Wave
from mjfish.effects import Causes, Effect
from mjfish.errors import InputError
from mjfish.files import tomlfile
from mjfish.files.plain_data import unsaved
from mjfish.files.result import Result
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.model import extended
from mjfish.model.model import Prepared
from mjfish.model.origin import outside
from mjfish.mujoco.viewer import Player, Tank
from mjfish.numerics.arrays import FloatArray, readonly

#: Percentages of the fish that are slower.
LEVELS = (5.0, 50.0, 95.0)


@dataclass(frozen=True, eq=False)
class Band:
    """Quantiles over fish that swam the same run.

    Attributes:
        levels: (3,) percentages: 5, 50 and 95.
        time: (n,) increasing [s].
        velocity: (3, n, 3) quantiles of surge, sway [m/s] and yaw rate [rad/s] at each level.
        mean_surge: (3,) quantiles of the mean surge of the second half of the run [m/s].
        mean_yaw_rate: (3,) likewise of the mean yaw rate [rad/s].
        fish: how many are in it.
    """

    levels: tuple[float, ...]
    time: FloatArray
    velocity: FloatArray
    mean_surge: tuple[float, ...]
    mean_yaw_rate: tuple[float, ...]
    fish: int

    def summary(self) -> str:
        """Return the quantiles of the means of the second half, in a line."""
        surge, yaw = (" / ".join(f"{value:.3f}" for value in own) for own in (self.mean_surge, self.mean_yaw_rate))
        levels = " / ".join(f"{level:g}" for level in self.levels)
        return f"{levels} % of {self.fish} draws: mean surge of the second half {surge} m/s, mean yaw rate {yaw} rad/s"

    def write_table(self, path: str | Path) -> None:
        """Write time and quantiles, ``surge_5 [m/s]`` and so on, as CSV or Parquet.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        columns = {
            f"{channel}_{level:g} [{UNITS[channel]}]": self.velocity[i, :, k]
            for k, channel in enumerate(CHANNELS)
            for i, level in enumerate(self.levels)
        }
        write_table(path, {"time [s]": self.time, **columns})


def band(time: FloatArray, velocities: Sequence[FloatArray]) -> Band:
    """Return the band of velocities (n, 3), one a fish, all at the same times (n,) [s]."""
    every = np.stack(velocities)
    means = np.percentile(every[:, len(time) // 2 :].mean(axis=1), LEVELS, axis=0)
    surge, yaw = (tuple(map(float, means[:, k])) for k in (0, 2))
    return Band(LEVELS, time, np.percentile(every, LEVELS, axis=0), surge, yaw, len(every))


#: Longest step of both engines [s].
STEP = 0.001
#: Samples a second of a run whose drive is a mode or a wave.
RATE = 100.0
#: Longest run that is simulated [s], and most samples of it: more would fill the memory.
LONGEST, MOST = 1e4, 1e7


@dataclass(frozen=True, eq=False)
class Simulation(Result):
    """A simulated run, as far as it went.

    Attributes:
        fish: name of the fish.
        drive: name of the mode, ``wave``, or the file of the joint angles.
        engine: ``ode`` or ``mujoco``.
        effects: which are on, in words.
        status: ``ok`` or ``diverged``.
        message: when and with which parameters it diverged, else empty.
        time: (n,) increasing [s].
        velocity: (n, 3) surge, sway [m/s], yaw rate [rad/s] of the nose, as the camera reads them.
        pose: (n, 3) x, y [m], yaw [rad].
        joint_angle: (n, joints) [rad].
        attitude: (n, 3) roll, pitch [rad], heave [m] of a fish that is free in space; None: in the plane.
        prepared: what was simulated.
        motion: of the joints, as the engine realised it.
        states: (m, 6 or more) velocity and pose at the boundaries of the steps of `motion`, for forces
            (`mjfish.ode.forces.link_forces`).
        band: of other fish in the same run, see `with_band`; None: there are none.
    """

    fish: str
    drive: str
    engine: Literal["ode", "mujoco"]
    effects: tuple[str, ...]
    status: Literal["ok", "diverged"]
    message: str
    time: FloatArray
    velocity: FloatArray
    pose: FloatArray
    joint_angle: FloatArray
    attitude: FloatArray | None
    prepared: Prepared = unsaved()
    motion: JointMotion = unsaved()
    states: FloatArray = unsaved()
    band: Band | None = None

    def with_band(self, draws: Iterable[Simulation]) -> Simulation:
        """Return the run with the band of other fish in it, such as draws of `mjfish.sample`.

        Args:
            draws: the same run by other fish; those that diverged are left out.

        Raises:
            InputError: none of them got through, or one is another run or at other times.
        """
        through = [draw for draw in draws if draw.status == "ok"]
        if not through:
            raise InputError(f"{self.drive}: none of the draws swam to the end; sample others, or give a slower drive")
        for draw in through:
            if (draw.fish, draw.drive) != (self.fish, self.drive) or not np.array_equal(draw.time, self.time):
                raise InputError(
                    f"a draw of {draw.fish} swam {draw.drive} for {draw.time[-1]:g} s, expected {self.fish}, "
                    f"{self.drive}, {self.time[-1]:g} s; give draws of the same fish, simulated alike"
                )
        return replace(self, band=band(self.time, [draw.velocity for draw in through]))

    def summary(self) -> str:
        """Return fish, drive, engine and mean surge of the second half, its band, the effects; at most ten lines."""
        head = f"{self.fish}, {self.drive}, {self.engine}: "
        if self.status != "ok":
            return head + f"{self.status}: {self.message}"
        surge = self.velocity[len(self.time) // 2 :, 0].mean()
        others = [] if self.band is None else [self.band.summary()]
        return "\n".join([f"{head}mean surge of the second half {surge:.3f} m/s", *others, *self.effects][:10])

    def write_table(self, path: str | Path) -> None:
        """Write time, velocity, pose, joint angles and attitude, if any, as CSV or Parquet (see `mjfish.compare`).

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        joints = (columns.joint(k + 1) for k in range(self.joint_angle.shape[1]))
        names = ["time", *CHANNELS, *columns.POSE, *joints]
        table = np.column_stack([self.time, self.velocity, self.pose, self.joint_angle])
        if self.attitude is not None:
            names, table = [*names, *columns.ATTITUDE], np.column_stack([table, self.attitude])
        write_table(path, {columns.header(name): table[:, k] for k, name in enumerate(names)})


def simulate(
    fish: Fish | extended.Extended | str | Path = "pike",
    mode: str = "v1",
    *,
    engine: Literal["ode", "mujoco"] = "ode",
    values: Mapping[str, float] | None = None,
    effects: Causes = None,
    drive: Wave | str | Path | None = None,
    duration: float = modes.DURATION,
    free: bool = False,
) -> Simulation:
    """Simulate one run of a fish from rest, with the effects of its file and those that get values.

    Args:
        fish: a fish, the name of a shipped one, a fish TOML with its effects, or a draw of `mjfish.sample`.
        mode: of swimming, see [Yu2016], Table IV; the fish needs a CPG.
        engine: ``ode``, the equation in the frame of the head, or ``mujoco``, whose servos follow the command.
        values: coefficients and parameters of effects by full name, e.g. ``{"munk_moment.kappa": 1.0}``.
        effects: that may occur, by name, or Python files with causes of your own; None: the shipped ones.
        drive: instead of a mode: a wave, or a CSV or Parquet file with columns ``time [s]``, ``joint_1 [rad]``, ...
        duration: of the run [s]; a file of joint angles has its own.
        free: whether the fish may roll, pitch and heave, in MuJoCo only.

    Returns:
        The run at 100 samples a second, or at those of the file; one that diverges ends there and says so.

    Raises:
        UnknownNameError: no such fish, mode, coefficient, effect or parameter; the known ones are listed.
        ParameterError: a value outside its bounds.
        InputError: a drive that does not fit the fish, or an effect that the run cannot have.

    Warns of a run whose joints beat or swing otherwise than in the runs that an identified fish was fitted to.

    Example:
        >>> import mjfish
        >>> run = mjfish.simulate("pike", "v1", values={"munk_moment.kappa": 1.0}, duration=1.0)
        >>> run.velocity.shape
        (101, 3)
        >>> print(run)
        pike, v1, ode: mean surge of the second half ... m/s
        with munk_moment: kappa = 1
    """
    if free and engine != "mujoco":
        raise InputError("free: the ODE is planar; choose the engine mujoco")
    extended_fish = extended.load(fish, effects, values)
    run, trial = prepared(extended_fish, mode, drive=drive, duration=duration)
    simulated = _in_mujoco(run, free) if engine == "mujoco" else _in_ode(run, free)
    state = simulated.state
    for effect, own in run.active:
        state = effect.reading(state, own, trial)
    kept = np.isfinite(state[:, :6]).all(axis=1)
    if left := outside(extended_fish.model.fish, trial):
        warnings.warn(left, stacklevel=2)
    return Simulation(
        fish=extended_fish.fish.name,
        drive=trial.name,
        engine=engine,
        effects=tuple(extended_fish.described()),
        status=simulated.status,
        message=simulated.message,
        time=trial.time[kept],
        velocity=state[kept, :3],
        pose=state[kept, 3:6],
        joint_angle=simulated.joint_angle[kept],
        attitude=simulated.attitude[kept] if free else None,
        prepared=run,
        motion=simulated.motion,
        states=simulated.states,
    )


def prepared(
    fish: Fish | extended.Extended | str | Path,
    mode: str = "v1",
    *,
    values: Mapping[str, float] | None = None,
    effects: Causes = None,
    drive: Wave | str | Path | None = None,
    duration: float = modes.DURATION,
) -> tuple[Prepared, Trial]:
    """Return what is simulated, and its drive as a trial; arguments and errors as of `simulate`."""
    extended_fish = extended.load(fish, effects, values)
    trial = _trial(extended_fish.model.fish, mode, drive, duration)
    check_can_act(extended_fish.model.effects, trial)
    return replace(extended_fish.model, step=STEP).prepare(trial, extended_fish.values), trial


def sample_times(duration: float, rate: float) -> FloatArray:
    """Return the times (n,) [s] of the samples of a run, `rate` [Hz] a second.

    Raises:
        InputError: the run has no length, is longer than `LONGEST`, or has more than `MOST` samples.
    """
    if not (0.0 < duration <= LONGEST and 0.0 < rate <= MOST / duration):
        raise InputError(
            f"duration {duration:g} s at {rate:g} Hz: expected more than 0 and at most {LONGEST:g} s, more than 0 Hz, "
            f"and at most {MOST:g} samples; correct it"
        )
    return readonly(np.arange(int(duration * rate + 1e-9) + 1) / rate)


def check_can_act(effects: Iterable[Effect], trial: Trial) -> None:
    """Raise `InputError` where a run cannot have an effect that is asked for."""
    for effect in effects:
        if reason := effect.cannot_act(trial):
            raise InputError(f"{effect.name}: {reason}; `mjfish.generate` takes one, or leave the effect out")


def parse_wave(text: str) -> Wave:
    """Return the wave that a TOML inline table describes, without its braces.

    Args:
        text: e.g. ``frequency = 1.5, amplitude = [0.2, 0.3], phase = [0.0, -0.8]`` in Hz and rad; ``bias`` [rad] and
            ``ramp`` [s] are 0 by default.

    Raises:
        InputError: it cannot be read, a key is wrong, or there is not one of everything a joint.
    """
    try:
        raw = tomllib.loads(f"wave = {{{text}}}")["wave"]
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f"wave: found '{text}', expected e.g. frequency=1.5, amplitude=[0.2, 0.3], phase=[0, -0.8]: {error}"
        ) from None
    law = tomlfile.parse(raw, Law, "wave")
    bias = law.bias or (0.0,) * len(law.amplitude)
    if not len(law.amplitude) == len(law.phase) == len(bias):
        raise InputError(f"wave: found '{text}', expected one amplitude, phase and bias a joint; correct it")
    return Wave(law.frequency, law.amplitude, law.phase, bias, law.ramp)


def _trial(fish: Fish, mode: str, drive: Wave | str | Path | None, duration: float) -> Trial:
    """Return the drive as a trial in which nothing was measured."""
    if drive is None and fish.cpg is None:
        raise InputError(
            f"{fish.name} has no [cpg], which a mode of swimming needs; add one, drive it by a wave or by joint "
            "angles, or name another fish"
        )
    time = sample_times(duration, RATE)
    if drive is None:
        return Trial(mode, None, time, readonly(np.zeros((len(time), 3))), drive=modes.drive(mode, fish.joints))
    if isinstance(drive, Wave):
        if drive.joints != fish.joints:
            raise InputError(
                f"the wave has {drive.joints} amplitudes, expected {fish.joints}, one a joint of {fish.name}"
            )
        return Trial("wave", None, time, readonly(np.zeros((len(time), 3))), wave=drive)
    path = Path(drive)
    table = read_table(path)
    names = ["time", *(columns.joint(k + 1) for k in range(fish.joints))]
    missing = [columns.header(name) for name in names if name not in table]
    more = [columns.header(name) for name in table if name.startswith(columns.JOINT) and name not in names]
    if missing or more:
        wrong = f"{', '.join(missing)} missing" if missing else f"{', '.join(more)} too many"
        raise InputError(
            f"{path}: {wrong}; expected the time and {fish.joints} joints, those of {fish.name}; correct it"
        )
    time = table["time"]
    validation.check_times(time, path)
    angle = readonly(np.stack([table[name] for name in names[1:]], axis=1))
    validation.check_angles(time, angle, path)
    return Trial(path.stem, None, time, readonly(np.zeros((len(time), 3))), joint_angle=angle)


@dataclass(frozen=True, eq=False)
class _Swum:
    """What an engine made of a run, at the sampled times: state (n, 8), NaN where it ended, joint angles, attitude."""

    state: FloatArray
    joint_angle: FloatArray
    attitude: FloatArray
    status: Literal["ok", "diverged"]
    message: str
    motion: JointMotion
    states: FloatArray


def _in_ode(run: Prepared, free: bool) -> _Swum:
    del free  # refused before
    rollout = ode.simulate(run.fish, run.motion, values=run.coefficients, velocity=run.velocity, loads=run.loads)
    time = np.minimum(run.time, run.motion.time[-1])
    angle, still = run.motion.angle_at(time), np.zeros((len(time), 3))
    return _Swum(rollout.at(time), angle, still, rollout.status, rollout.message, run.motion, rollout.at_steps())


def _in_mujoco(run: Prepared, free: bool) -> _Swum:
    swum = mujoco.simulate(
        run.fish, run.motion, values=run.coefficients, velocity=run.velocity, loads=run.loads,
        free=mujoco.Trim() if free else None,
    )  # fmt: skip
    time = np.minimum(run.time, run.motion.time[-1])
    states = np.column_stack([swum.velocity, swum.pose])
    series = np.column_stack([states, np.zeros((len(states), 2)), swum.attitude, swum.joint_angle])
    at = np.column_stack([np.interp(time, swum.time, column, right=np.nan) for column in series.T])
    return _Swum(at[:, :8], at[:, 11:], at[:, 8:11], swum.status, swum.message, swum.motion(), states)


def tank(
    fish: Fish | extended.Extended | str | Path = "pike",
    mode: str = "v1",
    *,
    values: Mapping[str, float] | None = None,
    effects: Causes = None,
    drive: Wave | str | Path | None = None,
    free: bool = False,
) -> Tank:
    """Return a fish in water for `mjfish.mujoco.viewer.show`; arguments and errors as of `mjfish.simulate`.

    The drive goes on with its last beat, a file of joint angles with all of it.
    """
    run, trial = prepared(fish, mode, values=values, effects=effects, drive=drive)
    beat = float(run.motion.time[-1])
    if trial.drive:
        beat = min(beat, 2.0 * math.pi / trial.drive[-1].omega)
    elif trial.wave is not None:
        beat = min(beat, 1.0 / trial.wave.frequency)
    trim = mujoco.Trim() if free else None
    return Tank(run.fish, Player(run.motion, beat), values=run.coefficients, free=trim, loads=run.loads)
