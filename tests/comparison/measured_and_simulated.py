"""A small measured dataset, and rollouts of it as anyone may write them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mjfish.data import Dataset, columns, load_dataset, save, write_table
from mjfish.fish import load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.01, 0.01, 0.05])


def measured(folder: Path, **changes: object) -> Dataset:
    """Generate two trials of four seconds, save them to a folder and load them from there."""
    arguments = {"noise": SIGMA, "duration": 4.2, "seed": 3, "name": "pool", **changes}
    save(generate(load_fish("pike"), ["v1", "v3"], **arguments), folder)  # type: ignore[arg-type]
    return load_dataset(folder)


def clean(rate: float, duration: float = 4.2, lead: float = 0.0) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return times (n,) and velocities (n, 3) of the same trials without noise; `lead` is added to the times."""
    truth = generate(load_fish("pike"), ["v1", "v3"], rate=rate, duration=duration)
    return {trial.name: (trial.time + lead, np.array(trial.velocity)) for trial in truth.trials}


def write(path: Path, time: FloatArray, velocity: FloatArray, channels: tuple[str, ...] = CHANNELS) -> Path:
    """Write a rollout with some of the channels."""
    path.parent.mkdir(parents=True, exist_ok=True)
    chosen = {columns.header(name): velocity[:, CHANNELS.index(name)] for name in channels}
    write_table(path, {columns.header("time"): time, **chosen})
    return path


def write_all(folder: Path, rate: float = 100.0, **changes: float) -> Path:
    """Write the rollout of every trial."""
    for name, (time, velocity) in clean(rate, **changes).items():
        write(folder / f"{name}.csv", time, velocity)
    return folder


def constant(dataset: Dataset, channel: int) -> Dataset:
    """Return the dataset with a channel that does not vary."""
    trials = []
    for trial in dataset.trials:
        velocity = trial.velocity.copy()
        velocity[:, channel] = 0.1
        trials.append(replace(trial, velocity=readonly(velocity)))
    return replace(dataset, trials=tuple(trials))
