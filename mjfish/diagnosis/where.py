"""Where the misfit sits: its shares by channel, trial, part of the run, phase of the beat, speed and rate of turning.

This is a picture for the reader; no verdict rests on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence
from mjfish.estimation import Problem
from mjfish.estimation.omnibus import beat_phase
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import BlockAngular, span
from mjfish.numerics.formats import channel_name, percent

Labels = np.ndarray[Any, Any]
#: Beats that count as start-up, and as transition after a change of the drive.
_BEATS = 3.0
PHASES = 8
FIFTHS = ("lowest fifth", "second fifth", "middle fifth", "fourth fifth", "highest fifth")


@dataclass(frozen=True)
class Where:
    """Shares of the systematic misfit's energy, each table adding up to one.

    Attributes:
        channel, trial, part, phase, speed, turn: where most of it is, counting shares against the share of samples.
        channels, trials, parts, phases, speeds, turns: all shares. Parts are ``start-up`` (the first three beats),
            ``transition`` (three beats after a change of the drive), ``steady``; phases are eighths of the last joint's
            beat; speeds and turns are fifths of all samples by surge and by |yaw rate| as the fitted model has them.
    """

    channel: str
    trial: str
    part: str
    phase: str
    speed: str
    turn: str
    channels: dict[str, float]
    trials: dict[str, float]
    parts: dict[str, float]
    phases: dict[str, float]
    speeds: dict[str, float]
    turns: dict[str, float]

    @property
    def densest(self) -> str:
        """The channel and the trial that hold most of it, in words."""
        return f"{channel_name(self.channel)} ({percent(self.channels[self.channel], 2)} of it), trial {self.trial}"


def locate(evidence: Evidence, directed: bool) -> Where:
    """Locate the systematic misfit of a fit.

    The systematic part of the residual is its projection on what the tests found: the signatures of all candidates
    where those explain it, else the omnibus basis. The directions of the coefficients are projected out first.

    Args:
        evidence: of the fit.
        directed: whether the candidates explain the misfit; else the omnibus basis pictures it.
    """
    problem = evidence.problem
    z = evidence.cleared
    systematic = z - span(BlockAngular.of(evidence.signatures)).off(z) if directed else evidence.waves.fitted(z)
    energy = systematic[: problem.measured] ** 2
    records = zip(*_seen(problem, evidence.fit.x), strict=True)
    channel, names, parts, phases, swum = (np.concatenate(column) for column in records)
    speeds, turns = fifths(swum[:, 0]), fifths(np.abs(swum[:, 2]))
    channels = _shares(channel, energy)
    return Where(
        channel=max(channels, key=channels.__getitem__),
        trial=_densest(names, energy),
        part=_densest(parts, energy),
        phase=_densest(phases, energy),
        speed=_densest(speeds, energy),
        turn=_densest(turns, energy),
        channels=channels,
        trials=_shares(names, energy),
        parts=_shares(parts, energy),
        phases=_shares(phases, energy),
        speeds=_shares(speeds, energy),
        turns=_shares(turns, energy),
    )


#: Labels (n,) of the rows of one record: channel, trial, part of the run, phase; predicted velocities (n, 3).
_Record = tuple[Labels, Labels, Labels, Labels, FloatArray]


def _seen(problem: Problem, x: FloatArray) -> Iterator[_Record]:
    """Yield the records of a problem, in the order of its rows: velocities of every trial, then every sensor."""
    every, labels = problem.predictions(x), [_labels(problem.model.fish.cpg, trial) for trial in problem.trials]

    def record(i: int, time: FloatArray, names: Sequence[str]) -> _Record:
        trial, count = problem.trials[i], len(names)
        at = np.clip(np.searchsorted(trial.time, time + 1e-9) - 1, 0, len(trial.time) - 1)
        part, phase, velocity = (np.repeat(block[at], count, axis=0) for block in (*labels[i], every[i]))
        return np.tile(np.array(names), len(time)), np.full(count * len(time), trial.name), part, phase, velocity

    for i, trial in enumerate(problem.trials):
        yield record(i, trial.time[problem.mask(i)], CHANNELS)
    for i, sensor in problem.sensors:
        names = [f"{sensor.name} {channel}" for channel in sensor.channels]
        yield record(i, sensor.time[problem.sensor_mask(i, sensor)], names)


def fifths(values: FloatArray) -> Labels:
    """Return, per sample, in which fifth of all samples its value lies."""
    return np.array(FIFTHS)[np.searchsorted(np.quantile(values, [0.2, 0.4, 0.6, 0.8]), values, side="right")]


def _shares(labels: Labels, energy: FloatArray) -> dict[str, float]:
    total = max(float(energy.sum()), 1e-300)
    return {str(label): float(energy[labels == label].sum()) / total for label in np.unique(labels)}


def _densest(labels: Labels, energy: FloatArray) -> str:
    """Return the label with the most energy a sample."""
    return str(max(np.unique(labels), key=lambda label: float(energy[labels == label].mean())))


def _labels(cpg: Any, trial: Trial) -> tuple[Labels, Labels]:
    """Return, per sample, the part of the run and the eighth of the beat."""
    phase = beat_phase(cpg, trial)
    lasting = _BEATS * float(trial.time[-1] - trial.time[0]) / max(abs(phase[-1] - phase[0]) / (2.0 * np.pi), 1.0)
    part = np.full(len(trial.time), "steady", dtype=object)
    if trial.starts_at_rest:
        part[trial.time < lasting] = "start-up"
    for segment in trial.drive[1:]:
        part[(trial.time >= segment.start) & (trial.time < segment.start + lasting)] = "transition"
    eighth = np.floor(np.mod(phase, 2.0 * np.pi) / (2.0 * np.pi) * PHASES).astype(int) % PHASES
    names = np.array([f"{k}/{PHASES} to {k + 1}/{PHASES}" for k in range(PHASES)], dtype=object)
    return part.astype(str), names[eighth].astype(str)
