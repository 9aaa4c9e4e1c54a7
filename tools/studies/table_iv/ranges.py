"""Ranges of the velocities in the modes of [Yu2016], Table IV: the published ones and those of simulated swimming.

    range = max V - min V = RMSE / nRMSE

over a whole run from rest on ([Yu2016], below Table IV): the only numbers of the measurement itself that are printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.estimation import Part, parts_of_trial
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray, readonly

Triple = tuple[float, float, float]

#: [Yu2016], Table IV: RMSE [m/s, m/s, rad/s] and normalised RMSE [-] of V_x, V_y, V_w; its signs of the axes do not
#: matter here (mjfish.fish.frames).
PAPER: dict[str, tuple[Triple, Triple]] = {
    "v1": ((0.040, 0.042, 0.253), (0.097, 0.047, 0.051)),
    "v3": ((0.051, 0.044, 0.349), (0.105, 0.043, 0.056)),
    "v5": ((0.073, 0.058, 0.508), (0.123, 0.058, 0.079)),
    "v7": ((0.095, 0.073, 0.619), (0.142, 0.068, 0.084)),
    "v1-v5": ((0.053, 0.035, 0.298), (0.117, 0.045, 0.059)),
    "v5-v1": ((0.062, 0.038, 0.276), (0.111, 0.034, 0.039)),
    "v1-t1": ((0.041, 0.036, 0.245), (0.109, 0.045, 0.048)),
    "v1-t2": ((0.041, 0.046, 0.304), (0.115, 0.059, 0.061)),
    "v3-t1": ((0.047, 0.041, 0.198), (0.100, 0.046, 0.034)),
    "v3-t2": ((0.057, 0.054, 0.335), (0.119, 0.053, 0.051)),
}

#: Samples a second; with twice as many, ranges of the pike grow by less than 1 %.
RATE = 100.0
#: Half of the last digit in Table IV.
_HALF_DIGIT = 0.0005


def published(names: Sequence[str] = modes.MODES) -> FloatArray:
    """Return the published ranges (modes, 3) of surge, sway [m/s], yaw rate [rad/s]."""
    return np.array([np.divide(*PAPER[name]) for name in names])


def rounding(names: Sequence[str] = modes.MODES) -> float:
    """Return the root mean square error of the logarithms of the published ranges: their numbers have three places."""
    share = np.array([[_HALF_DIGIT / np.array(numbers) for numbers in PAPER[name]] for name in names])
    return float(np.sqrt(np.mean(np.sum(np.square(share) / 3.0, axis=1))))


def smallest_rmse() -> FloatArray:
    """Return the smallest published RMSE of each channel (3,): no measurement has more noise than that."""
    return np.asarray(np.min([rmse for rmse, _ in PAPER.values()], axis=0))


def trials(names: Sequence[str] = modes.MODES) -> tuple[Trial, ...]:
    """Return the modes as trials with nothing measured in them."""
    time = readonly(np.arange(int(modes.DURATION * RATE + 1e-9) + 1) / RATE)
    still = readonly(np.zeros((len(time), len(CHANNELS))))
    return tuple(Trial(name, None, time, still, modes.drive(name)) for name in names)


@dataclass(frozen=True, eq=False)
class Ranges:
    """Ranges of one simulated mode.

    Attributes:
        mode: of Table IV.
        whole: (3,) over the whole run; surge, sway [m/s], yaw rate [rad/s].
        parts: (3,) over the ``start_up``, after a ``change`` of the drive, and of the ``steady`` swimming at the end.
        reached: (3,) when the later one of the two extremes is reached [s].
        settled: when the start-up ends [s].
        speed: mean surge of the steady swimming at the end [m/s].
    """

    mode: str
    whole: FloatArray
    parts: dict[Part, FloatArray]
    reached: FloatArray
    settled: float
    speed: float

    @classmethod
    def of(cls, trial: Trial, velocity: FloatArray) -> Ranges:
        """Return the ranges of velocities (n, 3) at the times of `trial`; NaN after a divergence."""
        inside = dict(parts_of_trial(trial))
        inside.pop("whole")
        inside["steady"] = inside["steady"] & (trial.time >= trial.drive[-1].start)  # not between start-up and change
        return cls(
            mode=trial.name,
            whole=np.ptp(velocity, axis=0),
            parts={part: np.ptp(velocity[chosen], axis=0) for part, chosen in inside.items()},
            reached=np.maximum(trial.time[np.argmax(velocity, axis=0)], trial.time[np.argmin(velocity, axis=0)]),
            settled=float(trial.time[inside["start_up"]][-1]),
            speed=float(np.mean(velocity[inside["steady"], 0])),
        )


def scatter(measured: FloatArray, simulated: Sequence[Ranges]) -> FloatArray:
    """Return how much the published ranges differ where the drive was the same until the extremes were reached.

    Modes such as v1, v1-v5 and v1-t1 start alike. Where the simulation has its extremes in that common part, any model
    gives the same range for all of them, whatever its coefficients: what is left about their mean is of the experiment.

    Args:
        measured: (modes, 3) published ranges.
        simulated: of the same modes.

    Returns:
        (3,) root mean square of log(range / mean of those that start alike), over the ranges that have such partners;
        NaN in a channel without.
    """
    starts = [modes.drive(one.mode)[0] for one in simulated]
    found: list[list[float]] = [[] for _ in CHANNELS]
    for channel in range(len(CHANNELS)):
        early = [one.reached[channel] < modes.CHANGE for one in simulated]
        for start in dict.fromkeys(starts):
            alike = [i for i, other in enumerate(starts) if other == start and early[i]]
            if len(alike) > 1:
                logs = np.log(measured[alike, channel])
                found[channel] += list(logs - logs.mean())
    return np.array([np.sqrt(np.mean(np.square(one))) if one else np.nan for one in found])
