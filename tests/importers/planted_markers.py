"""A kinematic fish whose pose and joint angles are known, seen by a camera as the fishsim robot was."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjfish import fish as fishes
from mjfish.arrays import FloatArray
from mjfish.importers.fishsim.markers import RATE, STATIONS

#: Station of each marker's link: its front hinge, and which link it is (0 = head).
_LINK_OF = (0, 0, 0, 1, 2, 3, 4, 5, 5)


@dataclass
class Planted:
    """What swims and how it is seen; `write` makes the file.

    Angles follow a wave that travels to the tail; the nose swims along its heading, swings and turns.
    """

    frames: int = 420
    beat: float = 0.9
    speed: float = 0.1
    turn: float = 0.05
    swing: float = 0.13
    heading: float = -2.5
    amplitude: tuple[float, ...] = (0.24, 0.21, 0.16, 0.10, 0.18)
    lag: float = 0.4
    bend: float = 0.03
    scale: float = 0.00104
    noise: float = 0.4
    tail_shift: tuple[float, float] = (0.0, 0.0)
    fin_shift: tuple[float, float] = (0.0, 0.0)
    body_shift: tuple[float, float] = (0.0, 0.0)
    seed: int = 1
    time: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.time = np.arange(self.frames) / RATE

    def joint_angle(self, time: FloatArray) -> FloatArray:
        """Return the joint angles (n, 5) [rad]."""
        phase = 2 * np.pi * self.beat * time[:, None] - self.lag * np.arange(5)
        return np.asarray(self.bend + np.array(self.amplitude) * np.cos(phase))

    def yaw(self, time: FloatArray, order: int = 0) -> FloatArray:
        """Return yaw [rad], or its rate [rad/s]."""
        omega = 2 * np.pi * self.beat
        if order:
            return np.asarray(self.turn - self.swing * omega * np.cos(omega * time))
        return np.asarray(self.heading + self.turn * time - self.swing * np.sin(omega * time))

    def velocity(self, time: FloatArray) -> FloatArray:
        """Return surge, sway [m/s] and yaw rate [rad/s] of the nose (n, 3)."""
        omega = 2 * np.pi * self.beat
        surge = self.speed + 0.2 * self.speed * np.cos(2 * omega * time)
        sway = 0.09 * np.cos(omega * time + 0.5)
        return np.column_stack([surge, sway, self.yaw(time, 1)])

    def pose(self) -> FloatArray:
        """Return x, y [m], yaw [rad] of the nose at the frames (n, 3), the world's y up the image."""
        fine = np.linspace(0.0, self.time[-1], 20 * (self.frames - 1) + 1)
        body, yaw = self.velocity(fine), self.yaw(fine)
        world = np.column_stack(
            [
                np.cos(yaw) * body[:, 0] - np.sin(yaw) * body[:, 1],
                np.sin(yaw) * body[:, 0] + np.cos(yaw) * body[:, 1],
            ]
        )
        step = fine[1] - fine[0]
        path = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * step * (world[1:] + world[:-1]), axis=0)])
        return np.column_stack([np.add(path[::20], (2.0, -1.2)), self.yaw(self.time)])

    def pixels(self) -> FloatArray:
        """Return the markers (n, 9, 2) [pixel], y down."""
        fish = fishes.load("eth_tendon")
        pose = self.pose()
        joint = np.cumsum(self.joint_angle(self.time), axis=1)
        towards_tail = pose[:, 2:] + np.pi + np.column_stack([np.zeros(self.frames), joint])
        direction = np.stack([np.cos(towards_tail), np.sin(towards_tail)], axis=-1)
        length = np.array([link.length for link in fish.links])
        front = pose[:, None, :2] + np.concatenate(
            [np.zeros((self.frames, 1, 2)), np.cumsum(length[:-1, None] * direction[:, :-1], axis=1)], axis=1
        )
        start = np.concatenate([[0.0], np.cumsum(length)])
        world = np.stack(
            [
                front[:, link] + (station - start[link]) * direction[:, link]
                for station, link in zip(STATIONS, _LINK_OF, strict=True)
            ],
            axis=1,
        )
        world[:, 2] += self.body_shift
        world[:, 3:] += self.tail_shift
        world[:, 8] += self.fin_shift
        pixel = world / self.scale * [1.0, -1.0]
        return np.asarray(pixel + np.random.default_rng(self.seed).normal(0.0, self.noise, pixel.shape))

    def write(self, path: Path, pixel: FloatArray | None = None) -> Path:
        """Write the file, of other pixels if given."""
        pixel = self.pixels() if pixel is None else pixel
        np.savetxt(path, pixel.reshape(self.frames, -1), delimiter=",")
        return path
