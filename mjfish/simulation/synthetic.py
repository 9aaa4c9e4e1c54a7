"""Synthetic datasets: simulated swimming with known coefficients and effects, plus noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypedDict, Unpack, cast

import numpy as np

from mjfish.data import Dataset, Role, Sensor, Tank, Trial
from mjfish.data.sensor import within
from mjfish.drive import modes as table_iv
from mjfish.effects import Causes, Effect, catalogue
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish, load_fish
from mjfish.model import Model, requested_motion
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.run import check_can_act, sample_times

#: Step of the generating model [s]: five times finer than that of the fits, so that they do not share its error.
STEP = 0.001


Observed = Literal["velocity", "pose"]
Joints = Literal["cpg", "measured", "commanded"]


class Recording(TypedDict, total=False):
    """How the synthetic trials are recorded.

    Attributes:
        rate: samples per second; 50.
        duration: of each trial [s]; that of Table IV.
        name: of the dataset; ``synthetic``.
        tank: the fish swims in; its poses are then written, without noise.
        places: x, y [m], yaw [rad] where each trial starts; none: the origin. Poses are written where given.
        sensors: that every trial has, too, at the times that they have within it and with white noise of their sigma.
        observe: ``velocity``, or ``pose``: places and headings of the nose, by sensors that state no sigma.
        joints: what is recorded of the joints: ``cpg``, its frequency and biases; ``measured`` or ``commanded`` angles.
        joint_noise: sigma of measured angles [rad].
    """

    rate: float
    duration: float
    name: str
    tank: Tank | None
    places: Sequence[Sequence[float]]
    sensors: Sequence[Sensor]
    observe: Observed
    joints: Joints
    joint_noise: float


def generate(
    fish: Fish | str | Path,
    modes: Sequence[str],
    *,
    values: Mapping[str, float] | None = None,
    effects: Sequence[Effect] | Causes = None,
    noise: Sequence[float] | FloatArray | None = None,
    seed: int = 0,
    held_out: Sequence[str] = (),
    **recording: Unpack[Recording],
) -> Dataset:
    """Simulate modes of [Yu2016], Table IV, and add white noise.

    Args:
        fish: with its coefficients, the name of a shipped one, or a fish TOML.
        modes: one trial each; a mode given twice is a repeat with other noise.
        values: coefficients and effect parameters by full name; the rest by default. An effect whose parameter is
            named acts.
        effects: a list of causes that act; or those that may act, by name or in Python files of your own; None: the
            shipped ones.
        noise: (3,) sigma of surge, sway [m/s], yaw rate [rad/s], of poses of x, y [m], heading [rad]; None or zeros:
            none, and the dataset states none.
        seed: of the noise.
        held_out: names of trials that are not to be fitted.
        **recording: rate, duration, name, tank, places, sensors, and what is observed, see `Recording`.

    Returns:
        The dataset: trials with time (n,) and velocity (n, 3) of the nose in the forward frame.

    Raises:
        InputError: a rollout that diverges, or a wrong argument.
        UnknownNameError: an unknown mode, trial or parameter.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate("pike", ["v1", "v3-t1"], values={"servo_lag.time_constant": 0.02}, duration=6.0)
        >>> [trial.velocity.shape for trial in pool.trials]
        [(301, 3), (301, 3)]
    """
    fish = fish if isinstance(fish, Fish) else load_fish(fish)
    rate, duration = recording.get("rate", 50.0), recording.get("duration", table_iv.DURATION)
    tank, places = recording.get("tank"), recording.get("places", ())
    observe = recording.get("observe", "velocity")
    sigma = np.zeros(3) if noise is None else np.array([*noise], dtype=np.float64)
    time = sample_times(duration, rate)
    _check(sigma, modes, duration, seed, recording.get("joint_noise", 0.0))
    model = Model(fish, with_named(effects, values or {}), step=STEP)
    truth = model.values(values)
    rng, draws = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    names = _trial_names(modes)
    for given in held_out:
        if given not in names:
            raise UnknownNameError("trial", given, names)
    trials = []
    for trial_name, mode, start in zip(names, modes, _starts(names, tank, places), strict=True):
        role: Role | None = ("held_out" if trial_name in held_out else "fit") if held_out else None
        begin = None if start is None else readonly(np.broadcast_to(start, (len(time), 3)))
        still = readonly(np.zeros((len(time), 3)))
        drive = table_iv.drive(mode, fish.joints)
        sensors = tuple(within(s, 0.0, float(time[-1]), s.name) for s in recording.get("sensors", ()))
        if observe == "pose":
            sensors = (
                Sensor("position", "position", time, np.zeros((len(time), 2))),
                Sensor("heading", "heading", time, np.zeros((len(time), 1))),
                *sensors,
            )
        blank = Trial(trial_name, role, time, still, drive, pose=begin, tank=tank, sensors=sensors)
        check_can_act(model.effects, blank)
        truth |= {f"{effect.name}.{k}": v for effect in model.effects for k, v in effect.drawn(draws).items()}
        predicted = model.predict(blank, truth)
        if predicted.status != "ok":
            raise InputError(f"{trial_name}: the simulated fish {predicted.message}")
        measured = predicted.velocity + rng.standard_normal((len(time), 3)) * sigma
        swum = None if begin is None else readonly(predicted.pose)
        if tank is not None and swum is not None and np.min(tank.distance(swum)) < 0.0:
            raise InputError(f"{trial_name}: the simulated fish swims through a wall of the tank; start it elsewhere")
        seen = tuple(map(_measured, sensors, predicted.sensors, [rng] * len(sensors)))
        trial = replace(blank, velocity=readonly(measured), pose=swum, sensors=seen)
        if observe == "pose":
            trial = _filmed(trial, sigma, rng)
        if recording.get("joints", "cpg") != "cpg":
            trial = _with_joints(model, blank, truth, trial, recording, rng)
        trials.append(trial)
    stated = readonly(sigma) if np.any(sigma > 0.0) and observe == "velocity" else None
    return Dataset(recording.get("name", "synthetic"), fish, tuple(trials), noise=stated)


def _filmed(trial: Trial, sigma: FloatArray, rng: np.random.Generator) -> Trial:
    """Return a trial without velocities and poses, with white noise on what the camera read."""
    position, heading, *others = trial.sensors
    places = position.values + rng.standard_normal(position.values.shape) * sigma[:2]
    turned = heading.values + rng.standard_normal(heading.values.shape) * sigma[2]
    seen = (replace(position, values=places), replace(heading, values=turned), *others)
    return replace(trial, velocity=readonly(np.full((len(trial.time), 3), np.nan)), pose=None, sensors=seen)


def _with_joints(
    model: Model, blank: Trial, truth: Mapping[str, float], trial: Trial, recording: Recording, rng: np.random.Generator
) -> Trial:
    """Return a trial from rest with recorded joint angles in place of its drive: those asked for, or those reached."""
    commanded, sigma = recording.get("joints") == "commanded", recording.get("joint_noise", 0.0)
    motion = requested_motion(model.fish.cpg, blank, STEP) if commanded else model.prepare(blank, truth).motion
    angle = motion.angle_at(trial.time)
    if not commanded:
        angle = angle + sigma * rng.standard_normal(angle.shape)
    return replace(trial, drive=(), joint_angle=readonly(angle), commanded=commanded, from_rest=True)


def _measured(sensor: Sensor, read: FloatArray, rng: np.random.Generator) -> Sensor:
    """Return a sensor with what it reads and white noise of its sigma."""
    sigma = 0.0 if sensor.sigma is None else sensor.sigma
    return replace(sensor, values=read + rng.standard_normal(read.shape) * sigma)


def with_named(effects: Sequence[Effect] | Causes, values: Mapping[str, float]) -> tuple[Effect, ...]:
    """Return the causes that are listed, and those of the known ones whose parameters are named in `values`."""
    listed = () if isinstance(effects, (str, Path, Mapping)) else effects or ()
    acting = [effect for effect in listed if isinstance(effect, Effect)]
    known = catalogue(None if acting else cast("Causes", effects))
    named = {name.partition(".")[0] for name in values} - {effect.name for effect in acting}
    return (*acting, *(effect for name, effect in known.items() if name in named))


def _starts(names: Sequence[str], tank: Tank | None, places: Sequence[Sequence[float]]) -> list[Sequence[float] | None]:
    """Return where each trial starts; None where no poses are written."""
    if len(places) == 0:
        return [(0.0, 0.0, 0.0) if tank is not None else None for _ in names]
    if len(places) != len(names) or not all(len(place) == 3 and np.isfinite(place).all() for place in places):
        raise InputError(f"{len(places)} places for {len(names)} trials; give x, y and yaw for each trial, or none")
    return list(places)


def _check(sigma: FloatArray, modes: Sequence[str], duration: float, seed: int, joint_noise: float) -> None:
    """Refuse arguments from which no dataset can be generated."""
    if sigma.shape != (3,) or not np.all(np.isfinite(sigma)) or np.any(sigma < 0.0):
        raise InputError(f"noise is {sigma.tolist()}, expected three numbers of at least 0: surge, sway, yaw rate")
    if np.any(sigma > 0.0) and not np.all(sigma > 0.0):
        raise InputError(f"noise is {sigma.tolist()}: give every channel some, or none any")
    if not 0.0 <= joint_noise < np.inf:
        raise InputError(f"joint_noise is {joint_noise:g} rad, expected a finite number of at least 0; correct it")
    if not modes:
        raise InputError("modes: found none, expected one a trial; name a mode")
    if seed < 0:
        raise InputError(f"seed is {seed}, expected 0 or more; choose another")
    for mode in modes:
        last = table_iv.drive(mode)[-1].start
        if last >= duration:
            raise InputError(
                f"mode '{mode}' changes at {last:g} s, after the end of a trial of {duration:g} s; make the trials "
                "longer, or choose a mode without a change"
            )


def _trial_names(modes: Sequence[str]) -> list[str]:
    """Return the modes as names; repeats get a number."""
    names: list[str] = []
    for mode in modes:
        count = sum(name == mode or name.startswith(f"{mode}.") for name in names)
        names.append(mode if count == 0 else f"{mode}.{count + 1}")
    return names
