"""Do pose and velocity belong to one motion? Kinematics alone answers, without a word about the water.

Measured are the pose (x, y, yaw) and, by another sensor or treatment, the body velocity u and yaw rate w. With the true
motion p(t) = (x, y), psi(t) the claim is

    u(t) = s Rot(a) R(psi)' p'(t + d) + b,        w(t) = s_w psi'(t + d_w) + b_w

(data compatibility check: Jategaonkar, Flight Vehicle System Identification (2006), ch. 10). Rotations in the plane
commute, so times a test function f_m with compact support, integrated by parts,

    INT f_m R(psi) u(t - d) dt = -s Rot(a) INT f_m' p dt + INT f_m R(psi) b dt

in which nothing measured is differentiated (weak form: Messenger & Bortz, J. Comput. Phys. 443 (2021)). The shift d is
applied to f_m and psi, never to u.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.data.check import GAP

#: Half the width of a test function [s], and at least this many samples: shorter than half a beat of any fish.
_HALF_WIDTH = 0.1
_FEWEST = 5
#: Gauss-Newton rounds for the shift, and lags of the correlation of errors: windows overlap, and noise may be slow.
_ROUNDS = 4
_LAGS = 12


@dataclass(frozen=True)
class Estimated:
    """A number with its standard error."""

    value: float
    error: float

    def off(self, null: float) -> float:
        """Return how many standard errors it is from `null`."""
        return abs(self.value - null) / max(self.error, 1e-300)


@dataclass(frozen=True)
class Compatibility:
    """What pose and velocity say of each other; parameters by name.

    Attributes:
        translation: ``scale`` [-], ``rotation`` [rad], ``skew`` [s], ``surge_bias``, ``sway_bias`` [m/s] of the
            velocity against the position; empty where no position was measured.
        turning: ``scale`` [-], ``skew`` [s], ``bias`` [rad/s] of the yaw rate against the yaw.
        derived: the velocity is a linear filter of the pose: made from it, so that agreement says nothing.
        trials: names of the trials with a pose.
    """

    translation: dict[str, Estimated]
    turning: dict[str, Estimated]
    derived: bool
    trials: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "translation": {name: vars(one) for name, one in self.translation.items()},
            "turning": {name: vars(one) for name, one in self.turning.items()},
            "derived": self.derived,
            "trials": list(self.trials),
        }


def compatibility(trials: Sequence[Trial]) -> Compatibility | None:
    """Compare pose and velocity of all trials that have both; None where none has, or none is long enough."""
    posed = [trial for trial in trials if trial.pose is not None]
    windows = [one for trial in posed for one in _windows(trial)]
    if not windows:
        return None
    placed = [one for one in windows if np.all(np.isfinite(one.position))]
    return Compatibility(
        translation=_translation(placed) if placed else {},
        turning=_turning(windows),
        derived=all(_derived(trial) for trial in posed),
        trials=tuple(trial.name for trial in posed),
    )


@dataclass(frozen=True, eq=False)
class _Window:
    """One stretch without gaps, with its test functions.

    Attributes:
        time, position, yaw, velocity: its samples (n,), (n, 2), (n,), (n, 3).
        centres: (m,) of the test functions [s].
        half: half their width [s].
    """

    time: FloatArray
    position: FloatArray
    yaw: FloatArray
    velocity: FloatArray
    centres: FloatArray
    half: float

    def bump(self, shift: float) -> FloatArray:
        """Return f_m(t + shift) (m, n): f = (1 - u^2)^4, u = (t - centre) / half."""
        return np.asarray(np.square(np.square(1.0 - np.square(self._inside(shift)))))

    def bump_rate(self) -> FloatArray:
        """Return f_m'(t) (m, n)."""
        u = self._inside(0.0)
        rest = 1.0 - np.square(u)
        return np.asarray(-8.0 / self.half * u * rest * rest * rest)

    def _inside(self, shift: float) -> FloatArray:
        return np.clip((self.time[None, :] + shift - self.centres[:, None]) / self.half, -1.0, 1.0)

    @property
    def weight(self) -> FloatArray:
        """Return the trapezium rule (n,); for functions that vanish at the ends it converges faster than any power."""
        return np.gradient(self.time)


def _windows(trial: Trial) -> list[_Window]:
    """Cut a trial at its gaps and at the steps of its drive, where the velocity jumps."""
    assert trial.pose is not None  # noqa: S101
    time = trial.time
    step = float(np.median(np.diff(time)))
    half = max(_HALF_WIDTH, _FEWEST * step)
    cuts = np.flatnonzero(np.diff(time) > GAP * step) + 1
    cuts = np.union1d(cuts, np.searchsorted(time, [segment.start for segment in trial.drive[1:]]))
    yaw = np.unwrap(trial.pose[:, 2])
    found = []
    for rows in np.split(np.arange(len(time)), cuts):
        if len(rows) < 5 * _FEWEST or time[rows[-1]] - time[rows[0]] < 5.0 * half:
            continue
        # The first samples after a start from rest hold the jump of an impulsive start.
        first, last = time[rows[0]] + 2.5 * half, time[rows[-1]] - 1.5 * half
        centres = np.arange(first, last, 0.5 * half)
        found.append(_Window(time[rows], trial.pose[rows, :2], yaw[rows], trial.velocity[rows], centres, half))
    return found


def _translation(windows: Sequence[_Window]) -> dict[str, Estimated]:
    splines = [make_interp_spline(one.time, one.yaw, k=3) for one in windows]

    def parts(shift: float) -> list[tuple[FloatArray, FloatArray]]:
        return [_translated(one, spline, shift) for one, spline in zip(windows, splines, strict=True)]

    (along, across, surge, sway), errors, skew = _fitted(parts, windows)
    scale = math.hypot(along, across)
    jacobian = np.array([[along, across], [-across / scale, along / scale]]) / scale
    spread = jacobian @ errors[:2, :2] @ jacobian.T
    return {
        "scale": Estimated(scale, math.sqrt(spread[0, 0])),
        "rotation": Estimated(math.atan2(across, along), math.sqrt(spread[1, 1])),
        "skew": Estimated(skew, math.sqrt(errors[4, 4])),
        "surge_bias": Estimated(float(surge), math.sqrt(errors[2, 2])),
        "sway_bias": Estimated(float(sway), math.sqrt(errors[3, 3])),
    }


def _translated(one: _Window, yaw: Any, shift: float) -> tuple[FloatArray, FloatArray]:
    """Return left side (2m,) and columns (2m, 4) for s cos a, s sin a and both biases."""
    bump, weight = one.bump(shift), one.weight
    inside = np.clip(one.time + shift, one.time[0], one.time[-1])
    left = (bump * weight) @ frames.to_world(one.velocity[:, :2], yaw(inside))
    moved = -(one.bump_rate() * weight) @ one.position
    turned = [
        (one.bump(0.0) * weight) @ frames.to_world(np.broadcast_to(unit, (len(weight), 2)), one.yaw)
        for unit in ((1.0, 0.0), (0.0, 1.0))
    ]
    quarter = np.stack([-moved[:, 1], moved[:, 0]], axis=1)
    return left.ravel(), np.stack([column.ravel() for column in (moved, quarter, *turned)], axis=1)


def _turning(windows: Sequence[_Window]) -> dict[str, Estimated]:
    def parts(shift: float) -> list[tuple[FloatArray, FloatArray]]:
        found = []
        for one in windows:
            turned = -(one.bump_rate() * one.weight) @ one.yaw
            column = np.stack([turned, one.bump(0.0) @ one.weight], axis=1)
            found.append(((one.bump(shift) * one.weight) @ one.velocity[:, 2], column))
        return found

    (scale, bias), errors, skew = _fitted(parts, windows)
    return {
        "scale": Estimated(float(scale), math.sqrt(errors[0, 0])),
        "skew": Estimated(skew, math.sqrt(errors[2, 2])),
        "bias": Estimated(float(bias), math.sqrt(errors[1, 1])),
    }


def _fitted(parts: Any, windows: Sequence[_Window]) -> tuple[FloatArray, FloatArray, float]:
    """Fit columns and shift by Gauss-Newton; return coefficients (k,), covariance (k + 1, k + 1) and the shift [s].

    The covariance is a sandwich that allows for errors that are correlated within a stretch ([Newey1987]).
    """
    delta = 0.05 * windows[0].half
    reach = 0.5 * windows[0].half
    shift = 0.0
    for _ in range(_ROUNDS):
        here, ahead, behind = parts(shift), parts(shift + delta), parts(shift - delta)
        slopes = [-(a[0] - b[0]) / (2.0 * delta) for a, b in zip(ahead, behind, strict=True)]
        design = np.concatenate([np.column_stack([p[1], slope]) for p, slope in zip(here, slopes, strict=True)])
        left = np.concatenate([p[0] for p in here])
        solution = np.linalg.lstsq(design, left)[0]
        shift = float(np.clip(shift + solution[-1], -reach, reach))
    residual = left - design @ solution
    bread = np.linalg.pinv(design.T @ design)
    meat = np.zeros_like(bread)
    row = 0
    for one, (side, _) in zip(windows, here, strict=True):
        rows = slice(row, row + len(side))
        row = rows.stop
        meat += _kernel(design[rows] * residual[rows, None], len(side) // len(one.centres))
    covariance = bread @ meat @ bread
    covariance[np.diag_indices_from(covariance)] += 1e-30
    return solution[:-1], covariance, shift


def _kernel(moments: FloatArray, every: int) -> FloatArray:
    """Return the long-run covariance (k, k) of moments (m, k), Bartlett kernel; `every` rows belong to one time."""
    total = moments.T @ moments
    for lag in range(1, _LAGS * every):
        if lag >= len(moments):
            break
        product = moments[lag:].T @ moments[:-lag]
        total += (1.0 - lag / (_LAGS * every)) * (product + product.T)
    return np.asarray(total)


def _derived(trial: Trial) -> bool:
    """Whether the yaw rate is a finite filter of the yaw (up to 12 samples to either side) to a millionth."""
    assert trial.pose is not None  # noqa: S101
    yaw, rate = np.unwrap(trial.pose[:, 2]), trial.velocity[:, 2]
    taps = 25
    if len(yaw) < 4 * taps or trial.gaps:
        return False
    lagged = np.lib.stride_tricks.sliding_window_view(yaw - yaw.mean(), taps)
    target = rate[taps // 2 : taps // 2 + len(lagged)]
    left = target - lagged @ np.linalg.lstsq(lagged, target)[0]
    return bool(np.std(left) < 1e-6 * np.std(target) + 1e-12)
