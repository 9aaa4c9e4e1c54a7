"""A simulated fish of known motion, filmed by a tilted pinhole camera as the fishsim robot was.

The projection is written on its own: rotation matrices and a division by the depth, nothing of the importer.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from mjfish import ode
from mjfish.drive.wave import Wave, joint_motion
from mjfish.fish import load_fish
from mjfish.numerics.arrays import FloatArray

RATE = 60.0
#: Stations of the nine markers of fishsim [m], the links they sit on, and their heights [m].
STATIONS = 0.08 + np.array([-0.077, 0.065, 0.28, 0.2995, 0.3295, 0.3615, 0.3905, 0.4115, 0.474])
LINKS = (0, 0, 0, 1, 2, 3, 4, 5, 5)
HEIGHTS = np.array([0.1, 0.1, 0.1, 0.04, 0.04, 0.04, 0.04, 0.04, 0.07])
FISH = load_fish("eth_tendon")
_WARM = 4.0


@functools.lru_cache(maxsize=16)
def _truth(wave: Wave, seconds: float, warm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (n,), states (n, 8) and joint angles (n, 5) of a swim that is `warm` seconds old when filmed."""
    motion = joint_motion(wave, 0.0, warm + seconds, 0.005)
    rollout = ode.simulate(FISH, motion, values=FISH.values, velocity=np.array([0.1, 0.0, 0.0]))
    time = np.arange(round(seconds * RATE)) / RATE
    return time, rollout.at(time + warm), motion.angle_at(time + warm)


@dataclass(frozen=True)
class Swim:
    """What swims and how it is seen.

    Attributes:
        beat: [Hz].
        seconds: filmed.
        warm: age of the swim when the film begins [s]; a young one still speeds up.
        heading: of the fish at first [rad].
        noise: of a marker [pixel].
        wander: correlation of its errors from frame to frame; 0 is white.
        tilt: of the camera [rad].
        height: of the camera over the markers of the head [m].
        roll: amplitude of its roll about the middle plane, a third of a beat behind the first joint [rad].
        heights: whether perspective shows the heights of the markers.
        seed: of noise and amplitude.
    """

    beat: float = 0.9
    seconds: float = 5.0
    warm: float = _WARM
    heading: float = -2.5
    noise: float = 0.6
    wander: float = 0.0
    tilt: float = 0.0
    height: float = 2.4
    focal: float = 2300.0
    heights: bool = False
    roll: float = 0.0
    seed: int = 0

    @property
    def wave(self) -> Wave:
        """Its joint law."""
        amplitude = np.array([0.24, 0.21, 0.16, 0.10, 0.18]) * (1.0 + 0.03 * (self.seed % 5))
        phase = -0.4 * np.arange(5) + 0.7 * self.seed
        return Wave(self.beat, tuple(amplitude.tolist()), tuple(phase.tolist()), (0.03,) * 5)

    @property
    def truth(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times (n,), velocities (n, 3) of the nose in the forward frame, joint angles (n, 5)."""
        time, state, angle = _truth(self.wave, self.seconds, self.warm)
        return time, state[:, :3], angle

    def pose(self) -> FloatArray:
        """Return x, y [m], yaw [rad] of the nose (n, 3); the fish swims through the middle of the image."""
        _, state, _ = _truth(self.wave, self.seconds, self.warm)
        turn = self.heading - state[0, 5]
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        place = (state[:, 3:5] - state[:, 3:5].mean(axis=0)) @ rotation.T
        return np.column_stack([place, state[:, 5] + turn])

    def rolled(self) -> FloatArray:
        """Return the roll (n,) [rad], positive with port up."""
        return np.asarray(self.roll * np.sin(2.0 * np.pi * (self.beat * self.truth[0] - 1.0 / 3.0)))

    def markers(self) -> FloatArray:
        """Return where the markers are (n, 9, 3) [m], z up from the middle plane of the fish."""
        pose, angle = self.pose(), self.truth[2]
        lengths = [link.length for link in FISH.links]
        starts = np.concatenate([[0.0], np.cumsum(lengths)])
        points = np.empty((len(pose), 9, 3))
        for marker, (station, link) in enumerate(zip(STATIONS, LINKS, strict=True)):
            place, direction = pose[:, :2].copy(), pose[:, 2] + np.pi
            for front in range(link):
                place += lengths[front] * np.column_stack([np.cos(direction), np.sin(direction)])
                direction = direction + angle[:, front]
            place += (station - starts[link]) * np.column_stack([np.cos(direction), np.sin(direction)])
            starboard = np.column_stack([np.sin(pose[:, 2]), -np.cos(pose[:, 2])])
            place += HEIGHTS[marker] * self.rolled()[:, None] * starboard
            points[:, marker] = np.column_stack([place, np.full(len(pose), HEIGHTS[marker])])
        return points

    def pixels(self) -> FloatArray:
        """Return the markers in the image (n, 9, 2), y down, with tracking noise."""
        points = self.markers()
        down = points - [0.0, -self.height * np.tan(self.tilt), self.height + HEIGHTS[0]]
        if not self.heights:
            down[..., 2] = -self.height
        cos, sin = np.cos(self.tilt), np.sin(self.tilt)
        depth = -cos * down[..., 2] + sin * down[..., 1]
        upward = cos * down[..., 1] + sin * down[..., 2]
        focal = self.focal / cos
        image = np.stack([1920.0 + focal * down[..., 0] / depth, 1080.0 - focal * upward / depth], axis=-1)
        rng = np.random.default_rng(self.seed + 100)
        white = rng.standard_normal((len(image) + 200, 9, 2))
        errors = lfilter([np.sqrt(1.0 - self.wander**2)], [1.0, -self.wander], white, axis=0)[200:]
        return np.asarray(image + self.noise * errors)

    def write(self, path: Path, spoil: Callable[[FloatArray], None] | None = None) -> Path:
        """Write a marker file, after spoiling its pixels in place."""
        pixel = self.pixels()
        if spoil is not None:
            spoil(pixel)
        np.savetxt(path, pixel.reshape(len(pixel), -1), delimiter=",")
        return path
