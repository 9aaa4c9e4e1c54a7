"""What is known of the errors of a smoothed record: modes that are independent of each other.

    (velocity, joint angles)(t) = truth + sum_m a_m e_m(t),   a_m ~ N(0, 1)

The modes e_m are a root of the errors' covariance, cov = sum_m e_m e_m'. A table of them has the columns ``mode [-]``,
counted from 1, ``time [s]`` as in the trial, the three velocities and the joints; the rows of a mode follow each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjfish.data import columns
from mjfish.data.trial import Trial
from mjfish.errors import InputError
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray, readonly

#: Share of the variance of the errors that modes may leave out.
_LEFT_OUT = 1e-3


def principal_modes(root: FloatArray) -> FloatArray:
    """Return the principal modes (modes, n, series) of errors, without those that hold a thousandth of the variance.

    Args:
        root: (series, n, k), whose square root root' is the covariance; every series counts by its own mean variance.
    """
    series, samples, _ = root.shape
    scale = np.sqrt(np.square(root).sum(axis=2).mean(axis=1))[:, None, None]
    flat = (root / np.maximum(scale, 1e-300)).reshape(series * samples, -1)
    vectors, values, _ = np.linalg.svd(flat, full_matrices=False)
    share = np.cumsum(values**2) / max(float(np.sum(values**2)), 1e-300)
    kept = int(np.searchsorted(share, 1.0 - _LEFT_OUT)) + 1
    modes = (vectors[:, :kept] * values[:kept]).reshape(series, samples, -1) * scale
    return np.asarray(modes.transpose(2, 1, 0))


def to_columns(trial: Trial) -> dict[str, FloatArray]:
    """Return the modes of a trial as columns by name.

    Raises:
        InputError: they do not have its samples, velocities and joints.
    """
    modes = np.asarray(trial.errors)
    expected = (len(trial.time), len(_names(trial)) - 2)
    if modes.shape[1:] != expected:
        raise InputError(
            f"trial '{trial.name}': errors have the last axes {modes.shape[1:]}, expected {expected}: a row for every "
            "time, the three velocities and the joints; correct them"
        )
    number = np.repeat(np.arange(1.0, len(modes) + 1.0), len(trial.time))
    rows = [number, np.tile(trial.time, len(modes)), *modes.reshape(-1, expected[1]).T]
    return dict(zip(_names(trial), rows, strict=True))


def from_columns(numbers: Mapping[str, FloatArray], trial: Trial, source: Path) -> FloatArray:
    """Return the modes (modes, n, 3 + joints) of a table: surge, sway [m/s], yaw rate [rad/s], joints [rad].

    Raises:
        InputError: rows or columns are not those of the trial.
    """
    names = _names(trial)
    if list(numbers) != names:
        found, expected = (", ".join(map(columns.header, which)) for which in (numbers, names))
        raise InputError(f"{source}: columns {found}, expected {expected}; write them so")
    count, rest = divmod(len(numbers["mode"]), len(trial.time))
    there = np.stack([numbers["mode"], numbers["time"]], axis=1)
    wanted = np.stack([np.repeat(np.arange(1.0, count + 1.0), len(trial.time)), np.tile(trial.time, count)], axis=1)
    if rest or not np.array_equal(there, wanted):
        raise InputError(
            f"{source}: expected the modes 1, 2, ... one after another, each with the {len(trial.time)} times of "
            f"trial '{trial.name}'; write them so, or remove 'errors' from its entry"
        )
    return readonly(np.stack([numbers[name] for name in names[2:]], axis=1).reshape(count, len(trial.time), -1))


def _names(trial: Trial) -> list[str]:
    joints = 0 if trial.joint_angle is None else trial.joint_angle.shape[1]
    return ["mode", "time", *CHANNELS, *(columns.joint(i + 1) for i in range(joints))]
