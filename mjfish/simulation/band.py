"""The band of many fish in the same run: quantiles of their velocities, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.data import write_table
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray

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
        surge = " / ".join(f"{value:.3f}" for value in self.mean_surge)
        yaw = " / ".join(f"{value:.3f}" for value in self.mean_yaw_rate)
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
