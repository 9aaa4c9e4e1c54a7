"""Noise of a camera, in kinds, with the true covariance of each."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy import linalg
from scipy.signal import lfilter, savgol_filter

from mjfish.numerics.arrays import FloatArray, readonly
from studies.battery.generator.camera import FINER

Kind = Literal["white", "differentiated", "drift", "heavy_tailed", "dropped_frames", "differentiated_path", "poses"]
#: Kinds that are drawn. `differentiated` has the noise of differentiated positions on velocities that are true;
#: of `differentiated_path` the swimming itself went through the filter, which smears every jump: not drawn. `poses` are
#: places and headings as a camera reads them.
KINDS: tuple[Kind, ...] = get_args(Kind)[:5]
#: Middle level: surge, sway [m/s], yaw rate [rad/s].
LEVEL = np.array([0.006, 0.006, 0.04])
RATE = 50.0
#: White part of differentiated positions (rounding, blur): without it their covariance is all but singular.
FLOOR = 0.05
#: Noise of recorded poses that are not differentiated: [m], [m], [rad].
POSE = np.array([0.001, 0.001, 0.003])
#: Noise of a recorded roll [rad].
ROLL = 0.005
#: Of poses: frames a second [Hz]; ranges of the noise of places [m], headings and joint angles [rad].
RATES = (25.0, 30.0, 50.0, 60.0, 100.0)
PLACES, HEADINGS, ANGLES = (3e-4, 3e-3), np.radians((0.1, 1.0)), np.radians((0.05, 0.5))
#: What is known of the joints beside the poses.
Joints = Literal["cpg", "commanded", "measured"]


@dataclass(frozen=True)
class Noise:
    """A kind of noise, and its numbers.

    Attributes:
        kind: of noise.
        sigma: standard deviation of surge, sway, yaw rate; of poses of x, y, heading.
        window, order: of the Savitzky-Golay filter that differentiates positions; finer: frames a sample.
        share: of the variance that drifts; memory: of the drift [s].
        lost: share of frames that are missing.
        rate: frames a second [Hz].
        joints: what of them is recorded; angle: noise of measured ones [rad].
    """

    kind: Kind
    sigma: tuple[float, float, float]
    window: int = 0
    order: int = 0
    finer: int = 1
    share: float = 0.0
    memory: float = 1.0
    lost: float = 0.0
    rate: float = RATE
    joints: Joints = "cpg"
    angle: float = 0.0


def draw(rng: np.random.Generator, kind: Kind | None = None, level: float | None = None) -> Noise:
    """Draw a noise; its level is 0.5 to 2 times the middle one."""
    kind = KINDS[int(rng.integers(len(KINDS)))] if kind is None else kind
    if kind == "poses":
        place, heading, angle = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (PLACES, HEADINGS, ANGLES))
        how = str(rng.choice(get_args(Joints)))
        return Noise(kind, (place, place, heading), rate=float(rng.choice(RATES)), joints=how, angle=angle)
    factor = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
    sigma = (factor if level is None else level) * LEVEL
    window = int(rng.choice(np.arange(5, 16, 2)))
    return Noise(
        kind=kind,
        sigma=(float(sigma[0]), float(sigma[1]), float(sigma[2])),
        window=window if "differentiated" in kind else 0,
        order=(2 if window < 9 and kind == "differentiated" else 4) if "differentiated" in kind else 0,
        finer=FINER if kind == "differentiated_path" else 1,
        share=float(rng.uniform(0.2, 0.7)) if kind == "drift" else 0.0,
        memory=float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))),
        lost=float(rng.uniform(0.03, 0.08)) if kind == "dropped_frames" else 0.0,
    )


def sample(noise: Noise, n: int, rng: np.random.Generator) -> FloatArray:
    """Return n rows of noise on the three velocities; positions that are differentiated have their own way."""
    sigma = np.array(noise.sigma)
    white = rng.standard_normal((n, 3))
    if noise.kind == "differentiated":
        places = of_position(noise) * rng.standard_normal((n, 3))
        return np.asarray(differentiator(n, noise.window, noise.order, 1) @ places + FLOOR * sigma * white)
    if noise.kind == "heavy_tailed":
        return np.asarray(sigma * rng.standard_t(3.0, size=(n, 3)) / np.sqrt(3.0))
    if noise.kind == "drift":
        a = np.exp(-1.0 / (noise.memory * RATE))
        kicks = np.sqrt(1.0 - a * a) * rng.standard_normal((n, 3))
        kicks[0] = rng.standard_normal(3)
        slow = lfilter([1.0], [1.0, -a], kicks, axis=0)
        return np.asarray(sigma * (np.sqrt(noise.share) * slow + np.sqrt(1.0 - noise.share) * white))
    return np.asarray(sigma * white)


def kept(noise: Noise, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return which of n frames are there (n,): lost ones come in bursts of one to four; first and last stay."""
    there = np.ones(n, dtype=bool)
    while np.mean(~there) < noise.lost:
        begin = int(rng.integers(1, n - 5))
        there[begin : begin + int(rng.integers(1, 5))] = False
    return there


@functools.lru_cache(maxsize=64)
def differentiator(n: int, window: int, order: int, finer: int) -> FloatArray:
    """Return the matrix (n, m) that takes the m = finer (n - 1) + 1 positions of all frames to n velocities [1/s]."""
    frames = finer * (n - 1) + 1
    return readonly(savgol_filter(np.eye(frames), window, order, deriv=1, delta=1.0 / (finer * RATE), axis=0)[::finer])


@functools.lru_cache(maxsize=64)
def smoother(n: int, window: int, order: int, finer: int) -> FloatArray:
    """Return the matrix (n, m) that smooths the heading of all frames by the same filter."""
    return readonly(savgol_filter(np.eye(finer * (n - 1) + 1), window, order, axis=0)[::finer])


def of_position(noise: Noise) -> FloatArray:
    """Return the noise (3,) of x, y [m] and heading [rad] whose differentiation has the noise's sigma."""
    gain = float(np.linalg.norm(differentiator(64, noise.window, noise.order, noise.finer)[32]))
    return np.array(noise.sigma) / gain


@functools.lru_cache(maxsize=64)
def _factor(noise: Noise, n: int) -> FloatArray | None:
    """Return the lower Cholesky factor (n, n) of the correlation of one channel; None for white."""
    if "differentiated" in noise.kind:
        d = differentiator(n, noise.window, noise.order, noise.finer)
        made = d @ d.T
        made = made / made[n // 2, n // 2] + FLOOR**2 * np.eye(n)
    elif noise.kind == "drift":
        lags = np.exp(-np.arange(n) / (noise.memory * RATE))
        made = linalg.toeplitz(noise.share * lags) + (1.0 - noise.share) * np.eye(n)
    else:
        return None
    return readonly(np.linalg.cholesky(made))


def whiten(noise: Noise, block: FloatArray) -> FloatArray:
    """Whiten a block (n, 3, ...) of one run by the true covariance of its channels (heavy tails by their variance)."""
    scaled = block / np.array(noise.sigma).reshape((1, 3) + (1,) * (block.ndim - 2))
    factor = _factor(noise, len(block))
    if factor is None:
        return np.asarray(scaled)
    flat = scaled.reshape(len(block), -1)
    return np.asarray(linalg.solve_triangular(factor, flat, lower=True, check_finite=False)).reshape(scaled.shape)
