"""The omnibus basis: what a misfit of any cause would look like, slowly changing and locked to the beat.

Per trial and channel: four hats over time (start-up, early, middle, late) times 1, cos and sin of the beat's phase and
of twice the phase. It knows no cause, and so sees those that are not on the list.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from mjfish.data import Trial
from mjfish.fish import Cpg
from mjfish.model import requested_motion
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import STEP

HATS = 4
HARMONICS = 2
#: Functions of the phase beside each hat.
WAVES = 1 + 2 * HARMONICS


def beat_phase(cpg: Cpg | None, trial: Trial) -> FloatArray:
    """Return the phase of the beat [rad] (n,) at the trial's samples: of the analytic signal of the last joint."""
    if trial.joint_angle is not None:
        angle = trial.joint_angle[:, -1]
        return np.asarray(np.unwrap(np.angle(signal.hilbert(angle - angle.mean()))))
    motion = requested_motion(cpg, trial, STEP)
    time = np.arange(0.0, motion.time[-1], 0.01)
    angle = motion.angle_at(time)[:, -1]
    slow = signal.sosfiltfilt(signal.butter(2, 0.5, fs=100.0, output="sos"), angle)  # a turn's bias comes as a step
    return np.asarray(np.interp(trial.time, time, np.unwrap(np.angle(signal.hilbert(angle - slow)))))


def hats(time: FloatArray, first: float, last: float, count: int = HATS) -> FloatArray:
    """Return piecewise linear hats (n, count) that sum to one from the `first` to the `last` time of a trial."""
    centres = np.linspace(first, last, count)
    return np.stack([np.interp(time, centres, row) for row in np.eye(count)], axis=1)


def functions(cpg: Cpg | None, trial: Trial, time: FloatArray) -> FloatArray:
    """Return the basis functions of one channel of a trial at some times (n, HATS (1 + 2 HARMONICS))."""
    phase = np.interp(time, trial.time, beat_phase(cpg, trial))
    turns = (turn(harmonic * phase) for harmonic in range(1, HARMONICS + 1) for turn in (np.cos, np.sin))
    waves = np.stack([np.ones_like(phase), *turns], axis=1)
    shape = hats(time, float(trial.time[0]), float(trial.time[-1]))
    return np.asarray(np.einsum("nh,nw->nhw", shape, waves).reshape(len(phase), -1))


def by_channel(waves: FloatArray, places: Sequence[int], channels: int) -> FloatArray:
    """Return functions (n, k) for each of some channels (n, places, channels k), in the columns of its place."""
    blocks = np.zeros((len(waves), len(places), channels, waves.shape[1]))
    blocks[:, range(len(places)), list(places)] = waves[:, None]
    return blocks.reshape(len(waves), len(places), -1)
