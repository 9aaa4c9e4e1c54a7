"""Planted datasets: simulated swimming with known coefficients, noise, and an effect hidden in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset, Role, Tank, Trial
from mjfish.drive import modes
from mjfish.effects.effect import Effect
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish
from mjfish.model import Model

#: Step of the planting model [s]: five times finer than that of the fits, so that they do not share its error.
STEP = 0.001


def generate(
    fish: Fish,
    mode_names: Sequence[str],
    *,
    values: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = (),
    noise: FloatArray | None = None,
    rate: float = 50.0,
    duration: float = modes.DURATION,
    seed: int = 0,
    held_out: Sequence[str] = (),
    name: str = "planted",
    tank: Tank | None = None,
    places: Sequence[Sequence[float]] = (),
) -> Dataset:
    """Simulate modes of Table IV and add white noise.

    Args:
        fish: with its coefficients.
        mode_names: one trial each; a mode given twice is a repeat with other noise.
        values: coefficients and effect parameters by full name; the rest by default.
        effects: in the planted truth.
        noise: (3,) sigma of surge, sway [m/s], yaw rate [rad/s]; None or zeros: none, and the dataset states none.
        rate: samples a second.
        duration: of each trial [s].
        seed: of the noise.
        held_out: names of trials that are not to be fitted.
        name: of the dataset.
        tank: the fish swims in; its poses are then written, without noise.
        places: x, y [m], yaw [rad] where each trial starts; none: the origin. Poses are written where given.

    Raises:
        InputError: a truth that diverges, or a wrong argument.
    """
    sigma = np.zeros(3) if noise is None else np.asarray(noise, dtype=np.float64)
    _check(sigma, mode_names, rate, duration, seed)
    model = Model(fish, tuple(effects), step=STEP)
    truth = model.values(values)
    rng = np.random.default_rng(seed)
    time = np.arange(int(np.floor(duration * rate + 1e-9)) + 1) / rate
    names = _trial_names(mode_names)
    for given in held_out:
        if given not in names:
            raise UnknownNameError("trial", given, names)
    trials = []
    starts = _starts(names, tank, places)
    for trial_name, mode, start in zip(names, mode_names, starts, strict=True):
        role: Role | None = ("held_out" if trial_name in held_out else "fit") if held_out else None
        begin = None if start is None else readonly(np.broadcast_to(start, (len(time), 3)))
        still = readonly(np.zeros((len(time), 3)))
        blank = Trial(trial_name, role, readonly(time), still, modes.drive(mode), pose=begin, tank=tank)
        predicted = model.predict(blank, truth)
        if predicted.status != "ok":
            raise InputError(f"{trial_name}: the planted fish {predicted.message}")
        measured = predicted.velocity + rng.standard_normal((len(time), 3)) * sigma
        swum = None if begin is None else readonly(predicted.pose)
        if tank is not None and swum is not None and np.min(tank.distance(swum)) < 0.0:
            raise InputError(f"{trial_name}: the planted fish swims through a wall of the tank; start it elsewhere")
        trials.append(replace(blank, velocity=readonly(measured), pose=swum))
    return Dataset(name, fish, tuple(trials), noise=readonly(sigma) if np.any(sigma > 0.0) else None)


def _starts(names: Sequence[str], tank: Tank | None, places: Sequence[Sequence[float]]) -> list[Sequence[float] | None]:
    """Return where each trial starts; None where no poses are written."""
    if places and (len(places) != len(names) or any(len(start) != 3 for start in places)):
        raise InputError(f"{len(places)} places for {len(names)} trials; give x, y and yaw for each trial, or none")
    if places:
        return list(places)
    return [(0.0, 0.0, 0.0) if tank is not None else None for _ in names]


def _check(sigma: FloatArray, mode_names: Sequence[str], rate: float, duration: float, seed: int) -> None:
    """Refuse arguments from which no dataset can be planted."""
    if sigma.shape != (3,) or not np.all(np.isfinite(sigma)) or np.any(sigma < 0.0):
        raise InputError(f"noise is {sigma.tolist()}, expected three numbers of at least 0: surge, sway, yaw rate")
    if np.any(sigma > 0.0) and not np.all(sigma > 0.0):
        raise InputError(f"noise is {sigma.tolist()}: give every channel some, or none any")
    if not 0.0 < rate < np.inf or not 0.0 < duration < np.inf:
        raise InputError(f"rate is {rate:g} Hz, duration {duration:g} s, expected finite numbers above 0; correct them")
    if seed < 0:
        raise InputError(f"seed is {seed}, expected 0 or more; choose another")
    for mode in mode_names:
        last = modes.drive(mode)[-1].start
        if last >= duration:
            raise InputError(
                f"mode '{mode}' changes at {last:g} s, after the end of a trial of {duration:g} s; make the trials "
                "longer, or choose a mode without a change"
            )


def _trial_names(mode_names: Sequence[str]) -> list[str]:
    """Return the modes as names; repeats get a number."""
    names: list[str] = []
    for mode in mode_names:
        count = sum(name == mode or name.startswith(f"{mode}.") for name in names)
        names.append(mode if count == 0 else f"{mode}.{count + 1}")
    return names
