"""Do pose and velocity belong to one motion? Kinematics alone answers, without a word about the water.

Measured are the pose (x, y, yaw) and, by another sensor or treatment, the body velocity u and yaw rate w. With the true
motion p(t) = (x, y), psi(t) the claim is

    u(t) = s Rot(a) R(psi)' p'(t + d) + b,        w(t) = s_w psi'(t + d_w) + b_w

(data compatibility check: Jategaonkar, Flight Vehicle System Identification (2006), ch. 10). Rotations in the plane
commute, so times a test function f_m with compact support, integrated by parts,

    INT f_m R(psi) u(t - d) dt = -s Rot(a) INT f_m' p dt + INT f_m R(psi) b dt

in which nothing measured is differentiated (weak form: Messenger & Bortz, J. Comput. Phys. 443 (2021)). The shift d is
applied to f_m and psi, never to u.

A velocity that somebody made by central differences, (p(t + h) - p(t - h)) / (2 h), loses the factor sin(w h) / (w h)
at the angular frequency w: 0.968 at 2.1 Hz and 30 frames a second. That is no scale of the camera, and it acts on the
yaw rate too. Then f_m'(t) in the integral becomes (f_m(t + h) - f_m(t - h)) / (2 h); the two are told apart because a
scale is the same at all frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import signal
from scipy.interpolate import make_interp_spline

from mjfish.data import Trial
from mjfish.data.validation import GAP, beats
from mjfish.fish import frames
from mjfish.fish.frames import UNITS
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import FloatArray

#: Half the width of a test function [s], and at least this many samples: shorter than half a beat of any fish.
_HALF_WIDTH, _FEWEST = 0.1, 5
#: Samples to either side over which central differences are tried; log-likelihood that they may lose to a free scale,
#: and the share of the windows that is independent.
_DIFFERENCES, _AS_GOOD, _INDEPENDENT = (1, 2, 3), 2.0, 0.25
#: Standard errors by which pose and velocity must disagree, and the least disagreement that is reported.
_SURE = 6.0
_LEAST = {
    "scale": 0.01, "rotation": math.radians(0.5), "skew": 0.002, "surge_bias": 0.005, "sway_bias": 0.005, "bias": 0.02,
}  # fmt: skip
#: A factor of this size is a unit, not a calibration.
_UNIT = 3.0
#: Gauss-Newton rounds for the shift, and lags of the correlation of errors: windows overlap, and noise may be slow.
_ROUNDS, _LAGS = 4, 12


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
        rotation: ``scale`` [-], ``skew`` [s], ``bias`` [rad/s] of the yaw rate against the yaw.
        derived: the velocity is a linear filter of the pose: made from it, so that agreement says nothing.
        differences: samples h to either side over which central differences were taken, of the positions and of the
            yaw; 0 where nothing says so.
        trials: names of the trials with a pose.
        loss: what these differences take off the beat, 1 - sin(w h) / (w h), at the highest beat frequency.
    """

    translation: dict[str, Estimated]
    rotation: dict[str, Estimated]
    derived: bool
    differences: tuple[int, int]
    trials: tuple[str, ...]
    loss: float


def compatibility(trials: Sequence[Trial]) -> Compatibility | None:
    """Compare pose and velocity of all trials that have both; None where none has, or none is long enough."""
    posed = [(trial, trial.pose) for trial in trials if trial.pose is not None]
    windows = [window for trial, pose in posed for window in _windows(trial, pose)]
    if not windows:
        return None
    placed = [window for window in windows if np.all(np.isfinite(window.position))]
    translation, of_positions = _explained(_translation, placed) if placed else ({}, 0)
    rotation, of_yaw = _explained(_turning, windows)
    omega = 2.0 * math.pi * max((f for trial, _ in posed for f in beats(trial)), default=0.0)
    reach = max(of_positions, of_yaw) * omega * max(trial.step for trial, _ in posed)
    return Compatibility(
        translation=translation,
        rotation=rotation,
        derived=all(_derived(trial, pose) for trial, pose in posed),
        differences=(of_positions, of_yaw),
        trials=tuple(trial.name for trial, _ in posed),
        loss=1.0 - float(np.sinc(reach / math.pi)),
    )


#: Estimates by name, and what they leave.
_Fitted = tuple[dict[str, Estimated], FloatArray]


def _explained(
    fit: Callable[[Sequence[_Window], int], _Fitted], windows: Sequence[_Window]
) -> tuple[dict[str, Estimated], int]:
    """Return the estimates, and over how many samples central differences explain a scale below 1; 0: they do not."""
    plain, most = fit(windows, 0)
    smaller = plain["scale"].value <= 1.0 and _is_off("scale", plain["scale"])
    for reach in _DIFFERENCES if smaller else ():
        estimates, left = fit(windows, reach)
        lost = _INDEPENDENT * len(left) * math.log((left @ left) / (most @ most))
        if not _is_off("scale", estimates["scale"]) and lost < _AS_GOOD:
            return estimates, reach
    return plain, 0


def _is_off(name: str, estimate: Estimated) -> bool:
    null = 1.0 if name == "scale" else 0.0
    return estimate.off(null) > _SURE and abs(estimate.value - null) > _LEAST[name]


@dataclass(frozen=True, eq=False)
class _Window:
    """One stretch without gaps, with its test functions.

    Attributes:
        time, position, yaw, velocity: its samples (n,), (n, 2), (n,), (n, 3).
        yaw_at: spline through the yaw.
        centres: (m,) of the test functions [s].
        half: half their width [s].
    """

    time: FloatArray
    position: FloatArray
    yaw: FloatArray
    velocity: FloatArray
    yaw_at: Any
    centres: FloatArray
    half: float

    def bump(self, shift: float) -> FloatArray:
        """Return f_m(t + shift) (m, n): f = (1 - u^2)^4, u = (t - centre) / half."""
        return np.asarray(np.square(np.square(1.0 - np.square(self._inside(shift)))))

    def bump_rate(self, reach: int) -> FloatArray:
        """Return f_m'(t) (m, n), or its central difference over `reach` samples to either side."""
        if reach:
            h = reach * float(np.median(np.diff(self.time)))
            return (self.bump(h) - self.bump(-h)) / (2.0 * h)
        u = self._inside(0.0)
        return np.asarray(-8.0 / self.half * u * (1.0 - np.square(u)) ** 3)

    def _inside(self, shift: float) -> FloatArray:
        return np.clip((self.time + shift - self.centres[:, None]) / self.half, -1.0, 1.0)


def _windows(trial: Trial, pose: FloatArray) -> Iterator[_Window]:
    """Cut a trial at its gaps and at the steps of its drive, where the velocity jumps."""
    time, half, yaw = trial.time, max(_HALF_WIDTH, _FEWEST * trial.step), np.unwrap(pose[:, 2])
    steps = np.searchsorted(time, [segment.start for segment in trial.drive[1:]])
    cuts = np.union1d(np.flatnonzero(np.diff(time) > GAP * trial.step) + 1, steps)
    for rows in np.split(np.arange(len(time)), cuts):
        if len(rows) >= 5 * _FEWEST and time[rows[-1]] - time[rows[0]] >= 5.0 * half:
            # The first samples after a start from rest hold the jump of an impulsive start.
            centres = np.arange(time[rows[0]] + 2.5 * half, time[rows[-1]] - 1.5 * half, 0.5 * half)
            here, spline = time[rows], make_interp_spline(time[rows], yaw[rows], k=3)
            yield _Window(here, pose[rows, :2], yaw[rows], trial.velocity[rows], spline, centres, half)


def _translation(windows: Sequence[_Window], reach: int) -> _Fitted:
    (cosine, sine, surge, sway, skew), errors, left = _fitted(_translated, windows, reach)
    scale = math.hypot(cosine, sine)
    jacobian = np.array([[cosine, sine], [-sine / scale, cosine / scale]]) / scale
    of_scale, of_rotation = np.sqrt(np.diag(jacobian @ errors[:2, :2] @ jacobian.T)).tolist()
    of_surge, of_sway, of_skew = np.sqrt(np.diag(errors)[2:]).tolist()
    return {
        "scale": Estimated(scale, of_scale),
        "rotation": Estimated(math.atan2(sine, cosine), of_rotation),
        "skew": Estimated(skew, of_skew),
        "surge_bias": Estimated(surge, of_surge),
        "sway_bias": Estimated(sway, of_sway),
    }, left


def _translated(window: _Window, shift: float, reach: int) -> tuple[FloatArray, FloatArray]:
    """Return left side (2m,) and columns (2m, 4) for s cos a, s sin a and both biases."""
    bump, weight = window.bump(shift), np.gradient(window.time)
    inside = np.clip(window.time + shift, window.time[0], window.time[-1])
    left = (bump * weight) @ frames.to_world(window.velocity[:, :2], window.yaw_at(inside))
    moved = -(window.bump_rate(reach) * weight) @ window.position
    turned = [
        (window.bump(0.0) * weight) @ frames.to_world(np.broadcast_to(unit, (len(weight), 2)), window.yaw)
        for unit in ((1.0, 0.0), (0.0, 1.0))
    ]
    quarter = np.stack([-moved[:, 1], moved[:, 0]], axis=1)
    return left.ravel(), np.stack([column.ravel() for column in (moved, quarter, *turned)], axis=1)


def _turning(windows: Sequence[_Window], reach: int) -> _Fitted:
    numbers, errors, left = _fitted(_turned, windows, reach)
    scale, bias, skew = map(Estimated, numbers, np.sqrt(np.diag(errors)).tolist())
    return {"scale": scale, "skew": skew, "bias": bias}, left


def _turned(window: _Window, shift: float, reach: int) -> tuple[FloatArray, FloatArray]:
    """Return left side (m,) and columns (m, 2) for the gain and the bias of the yaw rate."""
    weight = np.gradient(window.time)
    moved = -(window.bump_rate(reach) * weight) @ window.yaw
    return (window.bump(shift) * weight) @ window.velocity[:, 2], np.stack([moved, window.bump(0.0) @ weight], axis=1)


def _fitted(
    sides: Callable[[_Window, float, int], tuple[FloatArray, FloatArray]], windows: Sequence[_Window], reach: int
) -> tuple[list[float], FloatArray, FloatArray]:
    """Fit columns and shift by Gauss-Newton.

    Returns coefficients and the shift [s] (k + 1), their covariance (k + 1, k + 1), and the residual.

    Integrals are sums by the trapezium rule, which converges faster than any power for functions that vanish at the
    ends.

    The covariance is a sandwich that allows for errors that are correlated within a stretch ([Newey1987]): with
    Bartlett's kernel, that of sums over as many rows as it has lags.

    Args:
        sides: gives left side and columns of a window at a shift.
        windows: stretches without gaps.
        reach: samples to either side over which central differences were taken.
    """

    def stacked(shift: float) -> tuple[FloatArray, FloatArray]:
        left, columns = zip(*(sides(window, shift, reach) for window in windows), strict=True)
        return np.concatenate(left), np.concatenate(columns)

    delta, farthest, shift = 0.05 * windows[0].half, 0.5 * windows[0].half, 0.0
    for _ in range(_ROUNDS):
        (left, columns), ahead, behind = stacked(shift), stacked(shift + delta)[0], stacked(shift - delta)[0]
        design = np.column_stack([columns, (behind - ahead) / (2.0 * delta)])
        solution = np.linalg.lstsq(design, left)[0]
        shift = float(np.clip(shift + solution[-1], -farthest, farthest))
    residual = left - design @ solution
    counts = np.array([len(window.centres) for window in windows])
    at_once = len(left) // counts.sum()  # rows of one time
    long = np.ones((_LAGS * at_once, 1))
    moments = np.split(design * residual[:, None], np.cumsum(at_once * counts)[:-1])
    sums = np.concatenate([signal.oaconvolve(own, long, axes=0) for own in moments]) / math.sqrt(len(long))
    bread = np.linalg.pinv(design.T @ design)
    covariance = bread @ (sums.T @ sums) @ bread + 1e-30 * np.eye(len(bread))
    return [*solution[:-1].tolist(), shift], covariance, residual


def _derived(trial: Trial, pose: FloatArray) -> bool:
    """Whether the yaw rate is a finite filter of the yaw (up to 12 samples to either side) to a millionth."""
    yaw, taps = np.unwrap(pose[:, 2]), 25
    if len(yaw) < 4 * taps or trial.gaps:
        return False
    lagged = np.lib.stride_tricks.sliding_window_view(yaw - yaw.mean(), taps)
    target = trial.velocity[taps // 2 : taps // 2 + len(lagged), 2]
    return bool(np.std(target - lagged @ np.linalg.lstsq(lagged, target)[0]) < 1e-6 * np.std(target) + 1e-12)


def disagreements(found: Compatibility) -> Iterator[Finding]:
    """Yield what pose and velocity disagree about."""
    where = "pose and velocity"
    if found.derived:
        yield Finding(
            "compatibility-derived",
            "remark",
            where,
            "the velocity was computed from the pose by a filter, so that they agree whatever the camera's scale or "
            "clock",
            "two measurements that can check each other",
            "calibrate by a scale bar and a flash of light",
            trials=found.trials,
        )
        return
    if any(found.differences):
        yield Finding(
            "compatibility-differentiated",
            "remark",
            where,
            f"the velocity has the size of central differences over {2 * max(found.differences)} samples, which take "
            f"{found.loss:.1%} off the beat",
            "velocities that are the rates of the pose",
            "no scale is wrong; give the velocities as measured, or positions and yaw at a higher rate",
            trials=found.trials,
        )
    for estimates, channels in ((found.translation, ("surge", "sway")), (found.rotation, ("yaw_rate",))):
        for name, estimate in estimates.items():
            if _is_off(name, estimate):
                yield _disagreement(name, estimate, channels, found.trials)


def _disagreement(name: str, estimate: Estimated, channels: tuple[str, ...], trials: tuple[str, ...]) -> Finding:
    unit = name == "scale" and not 1.0 / _UNIT < abs(estimate.value) < _UNIT
    offset = "bias" in name
    code = "bias" if offset else "gain" if name == "scale" and channels == ("yaw_rate",) else name
    found, remedy = {
        "scale": (
            f"the velocity is {estimate.value:.4g} (+- {estimate.error:.2g}) times that of the pose",
            "check both units" if unit else "calibrate the scale of both, and divide the wrong one by this factor",
        ),
        "gain": (
            f"the yaw rate is {estimate.value:.4g} (+- {estimate.error:.2g}) times that of the yaw",
            "check both units" if unit else "calibrate the gain of the gyro; no scale of a camera changes an angle",
        ),
        "rotation": (
            f"the velocity is turned by {math.degrees(estimate.value):.2f} (+- {math.degrees(estimate.error):.2g}) "
            "degrees against the heading",
            "align the axes of the velocity, or the line that the heading is read from, with the body",
        ),
        "skew": (
            f"the velocity at t agrees with the pose at t {'+' if estimate.value > 0 else '-'} "
            f"{1e3 * abs(estimate.value):.2f} (+- {1e3 * estimate.error:.2g}) ms",
            "bring both to one clock",
        ),
        "bias": (
            f"the velocity has an offset of {estimate.value:.3g} (+- {estimate.error:.2g}) {UNITS[channels[0]]}",
            "take the offset at rest, and subtract it; a velocity against the water has that of a current",
        ),
    }[code]
    return Finding(
        f"compatibility-{code}",
        "blocks" if unit else "suspect",
        f"pose and velocity, {' and '.join(channels)}" + (f" ({name.partition('_')[0]})" if offset else ""),
        found,
        "velocities that are the rates of the pose",
        remedy,
        trials=trials,
        channels=channels,
    )
