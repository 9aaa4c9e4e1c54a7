"""Waves that are not known well: frequency and phase as nuisance parameters of their trial, and the scale of angles.

The phase is that in the middle of the record, where it does not trade with the frequency.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.importers.smoothing import beat_frequency
from mjfish.data.trial import for_looking
from mjfish.drive.walk import count
from mjfish.errors import InputError
from mjfish.fish.frames import CHANNELS
from mjfish.model import Model
from mjfish.parameters import Parameter

FREQUENCY, PHASE, SCALE, WALK = "wave.frequency", "wave.phase", "wave.scale", "walk"
#: Largest size of a mode of a walk, in units of that of the walk.
_FAR = 8.0
#: How far a frequency may be off [1], and how far a phase after `aligned` [rad]; scale of a phase [rad] and
#: of the scale of angles.
_OFF, _TURN, _PHASE_SCALE, _SCALE_SCALE = 0.05, 1.0, 0.05, 0.03
#: Phases tried by `aligned`.
_TRIED = 16


def walk(trial: Trial, size: float) -> Iterator[Parameter]:
    """Yield the modes of the walk of a trial's drive, of a size [s^0.5]; none where its joints were measured."""
    if size > 0.0 and not trial.joints_measured:
        for mode in range(count(float(trial.time[-1] - trial.time[0]))):
            name = f"{trial.name}:{WALK}.{mode}"
            yield Parameter(name, "s^0.5", 0.0, -_FAR * size, _FAR * size, 0.0, size, about="of the clock", sd=size)


def parameters(trial: Trial) -> tuple[Parameter, ...]:
    """Return frequency [Hz] and phase [rad] of a trial driven by a wave with a clock of its own, else nothing.

    The frequency is bounded by one turn over the record, so that no beat is lost or won.
    """
    if trial.wave is None or not trial.wave.free:
        return ()
    known, length = trial.wave.frequency, float(trial.time[-1] - trial.time[0])
    reach = min(_OFF * known, 1.0 / length)
    scale = _PHASE_SCALE / (np.pi * length)
    return (
        Parameter(
            f"{trial.name}:{FREQUENCY}", "Hz", known, known - reach, known + reach, known, scale, about="of the wave"
        ),
        Parameter(
            f"{trial.name}:{PHASE}", "rad", 0.0, -_TURN, _TURN, 0.0, _PHASE_SCALE, about="of the wave, mid-record"
        ),
    )


def scale(name: str) -> Parameter:
    """Return the scale of the angles of a wave, as a parameter of this name."""
    return Parameter(name, "-", 1.0, 0.2, 5.0, 1.0, _SCALE_SCALE, about="of the angles of the wave")


def clocked(trial: Trial, values: Mapping[str, float]) -> Trial:
    """Return the trial with the frequency, phase and scale that `values` have for its wave, and the walk."""
    modes: list[float] = []
    while (name := f"{trial.name}:{WALK}.{len(modes)}") in values:
        modes.append(values[name])
    if modes:
        trial = replace(trial, walk=tuple(modes))
    if trial.wave is None:
        return trial
    known = trial.wave.frequency
    frequency = values.get(f"{trial.name}:{FREQUENCY}", known) - known
    return _clocked(
        trial,
        frequency,
        values.get(f"{trial.name}:{PHASE}", 0.0),
        values.get(f"{trial.name}:{SCALE}", 1.0) * values.get(SCALE, 1.0),
    )


@functools.lru_cache(maxsize=64)
def _clocked(trial: Trial, frequency: float, phase: float, scale: float) -> Trial:
    return trial if frequency == phase == 0.0 and scale == 1.0 else trial.waved(frequency, phase, scale)


def beat(trial: Trial) -> float | None:
    """Return the frequency [Hz] of a beat that is not the stated one of a wave with a clock of its own; None: it is.

    It is that of the measured yaw rate, where this swings clearly; of a trial of `for_looking`, that of its heading.
    """
    if trial.wave is None or not trial.wave.free or not trial.measured[CHANNELS.index("yaw_rate")]:
        return None
    frequency, periodic = beat_frequency(trial.time, trial.velocity[:, CHANNELS.index("yaw_rate")])
    return frequency if periodic and abs(frequency / trial.wave.frequency - 1.0) > _OFF else None


def aligned(dataset: Dataset) -> Dataset:
    """Return the dataset with the phases of all waves with clocks of their own set to about the right turn.

    A wave of another frequency than the `beat` gets that of the beat. Of 16 phases the one is taken at which the
    nominal model correlates best with the measured sway and yaw rate, which swing with the beat whatever the
    coefficients are; the fit does the rest. Where places and headings were measured, these are of the smoothed path.
    """
    if not any(trial.wave is not None and trial.wave.free for trial in dataset.trials):
        return dataset
    model = Model(dataset.fish)
    return replace(dataset, trials=tuple(_aligned(model, trial) for trial in dataset.trials))


def _aligned(model: Model, trial: Trial) -> Trial:
    if trial.wave is None or not trial.wave.free:
        return trial
    seen = for_looking(trial)
    swinging = [c for c in (CHANNELS.index("sway"), CHANNELS.index("yaw_rate")) if seen.measured[c]]
    if not swinging:
        raise InputError(
            f"trial '{trial.name}': neither sway nor yaw rate, nor sensors of place and heading, expected one of them "
            "where the clock of a wave is free, for its phase shows in them; add it, or give the wave the clock of the "
            "recording (free = false)"
        )
    start = np.nan_to_num(seen.first_velocity)
    measured = seen.velocity[:, swinging] - seen.velocity[:, swinging].mean(axis=0)
    faster = beat(seen)
    trial = trial if faster is None else trial.waved(faster - trial.wave.frequency, 0.0)

    def correlation(turned: Trial) -> float:
        predicted = model.predict(turned, model.values(), velocity=start)
        if predicted.status != "ok":
            return -np.inf
        swing = predicted.velocity[:, swinging] - predicted.velocity[:, swinging].mean(axis=0)
        sizes = np.sqrt((swing**2).sum(axis=0) * (measured**2).sum(axis=0) + 1e-300)
        return float(np.sum((swing * measured).sum(axis=0) / sizes))

    return max((trial.waved(0.0, float(phase)) for phase in np.arange(_TRIED) * 2.0 * np.pi / _TRIED), key=correlation)
