"""Where the misfit sits: its shares by channel, trial, part of the run, phase of the beat, speed and rate of turning.

This is a picture for the reader; no verdict rests on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.block_angular import BlockAngular, span
from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence
from mjfish.estimation.omnibus import beat_phase
from mjfish.frames import CHANNELS

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
    energy = (systematic[: problem.samples] ** 2).reshape(-1, 3)
    labels = [_labels(problem.model.fish.cpg, trial) for trial in problem.trials]
    counted = [problem.mask(i) for i in range(len(problem.trials))]
    names = np.concatenate([np.full(int(k.sum()), t.name) for k, t in zip(counted, problem.trials, strict=True)])
    parts = np.concatenate([part[k] for (part, _), k in zip(labels, counted, strict=True)])
    phases = np.concatenate([phase[k] for (_, phase), k in zip(labels, counted, strict=True)])
    swum = np.concatenate([v[k] for v, k in zip(problem.predictions(evidence.fit.x), counted, strict=True)])
    speeds, turns = fifths(swum[:, 0]), fifths(np.abs(swum[:, 2]))
    per_sample = energy.sum(axis=1)
    total = max(float(per_sample.sum()), 1e-300)
    channels = {name: float(v) / total for name, v in zip(CHANNELS, energy.sum(axis=0), strict=True)}
    return Where(
        channel=max(channels, key=channels.__getitem__),
        trial=_densest(names, per_sample),
        part=_densest(parts, per_sample),
        phase=_densest(phases, per_sample),
        speed=_densest(speeds, per_sample),
        turn=_densest(turns, per_sample),
        channels=channels,
        trials=_shares(names, per_sample),
        parts=_shares(parts, per_sample),
        phases=_shares(phases, per_sample),
        speeds=_shares(speeds, per_sample),
        turns=_shares(turns, per_sample),
    )


def fifths(values: FloatArray) -> np.ndarray[Any, Any]:
    """Return, per sample, in which fifth of all samples its value lies."""
    edges = np.quantile(values, [0.2, 0.4, 0.6, 0.8])
    return np.array(FIFTHS)[np.searchsorted(edges, values, side="right")]


def _shares(labels: np.ndarray[Any, Any], energy: FloatArray) -> dict[str, float]:
    total = max(float(energy.sum()), 1e-300)
    return {str(label): float(energy[labels == label].sum()) / total for label in np.unique(labels)}


def _densest(labels: np.ndarray[Any, Any], energy: FloatArray) -> str:
    """Return the label with the most energy a sample."""
    return str(max(np.unique(labels), key=lambda label: float(energy[labels == label].mean())))


def _labels(cpg: Any, trial: Trial) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return, per sample, the part of the run and the eighth of the beat."""
    phase = beat_phase(cpg, trial)
    beats = abs(phase[-1] - phase[0]) / (2.0 * np.pi)
    lasting = _BEATS * float(trial.time[-1] - trial.time[0]) / max(beats, 1.0)
    part = np.full(len(trial.time), "steady", dtype=object)
    if trial.starts_at_rest:
        part[trial.time < lasting] = "start-up"
    for segment in trial.drive[1:]:
        part[(trial.time >= segment.start) & (trial.time < segment.start + lasting)] = "transition"
    eighth = np.floor(np.mod(phase, 2.0 * np.pi) / (2.0 * np.pi) * PHASES).astype(int) % PHASES
    names = np.array([f"{k}/{PHASES} to {k + 1}/{PHASES}" for k in range(PHASES)], dtype=object)
    return part.astype(str), names[eighth].astype(str)
