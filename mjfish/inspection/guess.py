"""Nominal rollouts before any fit: coefficients that nobody fitted are good enough for signs, units and labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish
from mjfish.model import Model

#: Clock shifts that are tried [s]: a late servo or clock must not look like a wrong sign, nor half a beat like none.
SHIFTS = np.arange(-6, 7) * 0.01
#: Fewest samples a beat in which a motion can be recognised.
_FEWEST = 5.0

Drive = tuple[DriveSegment, ...]


@dataclass(frozen=True, eq=False)
class Guess:
    """What the fish would do under a drive, at the times of a trial and shifted.

    Attributes:
        shifted: (s, n, 3) velocities at trial.time + `SHIFTS`.
    """

    shifted: FloatArray

    @property
    def velocity(self) -> FloatArray:
        """Velocities (n, 3) at the trial's own times."""
        return np.asarray(self.shifted[len(SHIFTS) // 2])


def sampled_enough(trial: Trial) -> bool:
    """Whether a CPG-driven trial has enough samples a beat, and not too long a time to simulate."""
    if not trial.drive:
        return True
    beat = 2.0 * np.pi / max(segment.omega for segment in trial.drive)
    return bool(trial.step * _FEWEST < beat and trial.time[-1] < 600.0)


def value_sets(fish: Fish) -> tuple[dict[str, float], ...]:
    """Return the coefficients that are tried: the fish's own, and those a fit starts from."""
    own = dict(fish.values)
    starts = {p.name: p.start for p in fish.parameters}
    return (own,) if own == starts else (own, starts)


def guesses(model: Model, trial: Trial, drives: Sequence[Drive], values: dict[str, float]) -> list[Guess | None]:
    """Predict what a trial would have measured under each of the drives; None where the rollout diverges.

    A trial with measured joint angles has no drive but its own: give ``[()]``.
    """
    shifted = trial.time[None, :] + SHIFTS[:, None]
    found: list[Guess | None] = []
    for drive in drives:
        start = None if trial.starts_at_rest else trial.velocity[0]
        rollout = model.predict(replace(trial, drive=drive, pose=None), values, velocity=start).rollout
        if rollout.status != "ok":
            found.append(None)
            continue
        inside = np.clip(shifted, rollout.time[0], rollout.time[-1])
        found.append(Guess(rollout.at(inside.ravel())[:, :3].reshape(*shifted.shape, 3)))
    return found
