"""What a log shows, on plain arrays: runs, and in each run one or more fish that swim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid

from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.forces import LinkForces
from mjfish.simulation.run import Band

#: Who swims: the recorded fish, the nominal and the extended model of a diagnosis, or a simulation on its own.
Swimmer = Literal["measured", "nominal", "extended", "simulated"]


@dataclass(frozen=True, eq=False)
class Swim:
    """One fish swimming; n samples in the forward frame.

    Attributes:
        swimmer: who it is.
        time: (n,) increasing [s].
        velocity: (n, 3) surge, sway [m/s], yaw rate [rad/s].
        pose: (n, 3) x, y [m], yaw [rad] of the nose.
        joint_angle: (n, joints) [rad].
        ghost: whether the angles are those of the command, because nobody measured them.
        words: what it is, for legends; empty: its swimmer.
        forces: on the links at the same instants, or None.
        attitude: (n, 3) roll, pitch [rad] and heave [m] of a fish that is free in space; None: in the plane.
    """

    swimmer: Swimmer
    time: FloatArray
    velocity: FloatArray
    pose: FloatArray
    joint_angle: FloatArray
    forces: LinkForces | None = None
    attitude: FloatArray | None = None
    ghost: bool = False
    words: str = ""

    @property
    def nose(self) -> FloatArray:
        """Place (n, 3) of the nose [m]."""
        depth = np.zeros(len(self.time)) if self.attitude is None else self.attitude[:, 2]
        return np.column_stack([self.pose[:, :2], depth])


@dataclass(frozen=True, eq=False)
class Run:
    """One run: the same swimming by one fish, measured or simulated or both.

    Attributes:
        name: of the trial.
        fish: its body.
        swims: one a swimmer, the measured one first if there is one and the best model last, on the same samples.
        held_out: whether nothing was fitted to it.
        band: of other fish in the same run, if any.
        command: (n, joints) what the joints were told [rad], at the samples of the first swim; None: not known.
        phase: (n,) of the beat at the same samples [rad]; None: not known.
        events: what happens, time [s] and words.
    """

    name: str
    fish: Fish
    swims: tuple[Swim, ...]
    held_out: bool = False
    band: Band | None = None
    command: FloatArray | None = None
    phase: FloatArray | None = None
    events: tuple[tuple[float, str], ...] = ()

    def residuals(self) -> dict[Swimmer, tuple[FloatArray, FloatArray]]:
        """Return time (n,) and measured - simulated velocity (n, 3) of every simulated swim."""
        first, *others = self.swims
        if first.swimmer != "measured":
            return {}
        return {swim.swimmer: (swim.time, first.velocity[: len(swim.time)] - swim.velocity) for swim in others}

    def error(self, swimmer: Swimmer) -> float | None:
        """Return the root mean square of a residual over the range of the measurement, the mean of the channels.

        None where there is nothing to compare: the measured fish itself, or one on its own.
        """
        found = self.residuals().get(swimmer)
        if found is None:
            return None
        rms = np.sqrt(np.mean(found[1] ** 2, axis=0))
        spread = np.ptp(self.swims[0].velocity, axis=0)
        there = np.isfinite(rms) & (spread > 0.0)
        return float(np.mean(rms[there] / spread[there])) if np.any(there) else None


def travelled(time: FloatArray, velocity: FloatArray, start: FloatArray) -> FloatArray:
    """Return the pose (n, 3) that velocities (n, 3) of the nose lead to, by the trapezoidal rule.

    x' = R(yaw) (surge, sway), yaw' = yaw_rate, from `start` (3,) x, y [m], yaw [rad].
    """
    yaw = start[2] + cumulative_trapezoid(velocity[:, 2], time, initial=0)
    place = cumulative_trapezoid(frames.to_world(velocity[:, :2], yaw), time, axis=0, initial=0)
    return np.column_stack([start[:2] + place, yaw])


def placed(forces: LinkForces, time: FloatArray, origin: FloatArray, at: FloatArray, pose: FloatArray) -> LinkForces:
    """Return the forces of one run on a fish that is elsewhere: seen from the nose they are the same.

    Linear between the samples.

    Args:
        forces: at `time` (m,), on a fish at `origin` (m, 3).
        time: (m,) increasing [s].
        origin: (m, 3) x, y [m], yaw [rad] of the nose.
        at: (n,) times that are wanted [s].
        pose: (n, 3) of the nose at these times.
    """
    index = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    share = np.clip((at - time[index]) / (time[index + 1] - time[index]), 0.0, 1.0)[:, None, None]

    def turned(samples: FloatArray) -> FloatArray:
        samples = np.concatenate([frames.to_body(samples[..., :2], origin[:, None, 2]), samples[..., 2:]], axis=2)
        between = (1.0 - share) * samples[index] + share * samples[index + 1]
        return np.concatenate([frames.to_world(between[..., :2], pose[:, None, 2]), between[..., 2:]], axis=2)

    joint = pose[:, None, :2] + turned(forces.joint - origin[:, None, :2])
    vectors = {name: turned(getattr(forces, name)) for name in ("axis", "drag", "added_mass", "load")}
    return LinkForces(joint=joint, length=forces.length, **vectors)
