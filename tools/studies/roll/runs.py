"""Runs of the free fish beside the planar one, and what the page tells of them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion, grid
from mjfish.fish import load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.mujoco import SimRollout, Trim, simulate
from mjfish.numerics.arrays import FloatArray

PIKE = load_fish("pike")
STEP = 0.001
OMEGAS = (18.0, 22.0, 26.0, 30.0)
BIASES = {"straight": modes.drive("v1")[0].bias, "t1": modes.drive("v1-t1")[1].bias, "t2": modes.drive("v1-t2")[1].bias}
TURNS = ("t1", "t2")
#: Coefficients: those of Table III; and others, with more added mass and less drag, as fast as the paper's fish.
WATERS: dict[str, dict[str, float] | None] = {
    "λ*": None,
    "alternative": {
        f"{kind}.{group}": value
        for kind, values in {"c_m": (3.0, 0.01, 0.40), "c_d": (4.0, 0.1, 0.18), "c_f": (0.02, 0.010, 0.009)}.items()
        for group, value in zip(("head", "body", "tail"), values, strict=True)
    },
}
#: Stretches of a run [s]: the start, the last of the straight half, the onset of the turn, the end.
START, STRAIGHT, ONSET, END = (0.0, 1.5), (3.2, 5.2), (5.2, 6.7), (8.4, 10.4)
WHOLE = (-1.0, np.inf)
#: Columns of the attitude.
ANGLES = ("roll", "pitch", "heave")
#: Height of a marker on the back above the axis of the fish: half of the highest section [m].
MARKER = 0.048
#: A fish that stands this steep has no roll angle to speak of [rad].
STEEP = np.radians(60.0)
#: The fast start: knots in time [s] and bend of every joint [rad], smooth in between.
_FAST = ((0.0, 0.1, 0.22, 0.38, 0.55, 2.0), (0.0, 0.0, 0.5, -0.3, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Pair:
    """The same swimming in the plane and free in space."""

    plane: SimRollout
    free: SimRollout

    def _within(self, stretch: tuple[float, float]) -> slice:
        return slice(*np.searchsorted(self.free.time, np.array(stretch) + 1e-9))

    def peak(self, stretch: tuple[float, float], what: str = "roll") -> float:
        """Return the largest angle [deg] in a stretch."""
        return float(np.degrees(np.abs(self.free.attitude[self._within(stretch), ANGLES.index(what)]).max()))

    def swing(self, stretch: tuple[float, float]) -> tuple[float, float]:
        """Return middle and amplitude of roll [deg] in a stretch."""
        roll = np.degrees(self.free.attitude[self._within(stretch), 0])
        return float(roll.max() + roll.min()) / 2.0, float(roll.max() - roll.min()) / 2.0

    def steep(self, stretch: tuple[float, float]) -> bool:
        """Return whether it stood on its nose or tail."""
        return bool(np.abs(self.free.attitude[self._within(stretch), 1]).max() > STEEP)

    def mean(self, stretch: tuple[float, float], channel: int, who: str = "free") -> float:
        """Return the mean of a velocity in a stretch."""
        run: SimRollout = getattr(self, who)
        return float(run.velocity[self._within(stretch), channel].mean())

    def change(self, stretch: tuple[float, float] = WHOLE, *, level: bool = False) -> FloatArray:
        """Return the RMS of free less planar velocity (3,), over the range of the planar one in the whole run [%].

        Args:
            stretch: [s].
            level: take the speed along the fish for surge, not the horizontal one.
        """
        part = self._within(stretch)
        swum = self.free.velocity.copy()
        if level:
            swum[:, 0] /= np.cos(self.free.attitude[:, 1])
        rms = np.sqrt(np.mean((swum - self.plane.velocity)[part] ** 2, axis=0))
        return np.asarray(100.0 * rms / np.ptp(self.plane.velocity, axis=0))

    def marker(self, stretch: tuple[float, float] = WHOLE) -> float:
        """Return the RMS of the sideways speed that roll gives a marker on the back, over the range of sway [%]."""
        part = self._within(stretch)
        speed = MARKER * np.gradient(self.free.attitude[:, 0], self.free.time)[part]
        return float(100.0 * np.sqrt(np.mean(speed**2)) / np.ptp(self.plane.velocity[:, CHANNELS.index("sway")]))


@functools.lru_cache(maxsize=512)
def mode(name: str, water: str = "λ*", trim: Trim = Trim()) -> Pair:  # noqa: B008 - frozen
    """Run a mode of Table IV, or ``fast``."""
    return _pair(fast_start() if name == "fast" else _motion(modes.drive(name)), water, trim)


@functools.lru_cache(maxsize=512)
def turn(omega: float, bias: str, water: str = "λ*", trim: Trim = Trim()) -> Pair:  # noqa: B008 - frozen
    """Run straight at a frequency, and from half of the run on with a bias."""
    segments = [cpg.DriveSegment(0.0, omega, BIASES["straight"])]
    if bias != "straight":
        segments.append(cpg.DriveSegment(modes.CHANGE, omega, BIASES[bias]))
    return _pair(_motion(tuple(segments)), water, trim)


def _motion(segments: tuple[cpg.DriveSegment, ...]) -> JointMotion:
    return cpg.joint_motion(PIKE.cpg, segments, modes.DURATION, STEP)


def _pair(motion: JointMotion, water: str, trim: Trim) -> Pair:
    plane, free = (simulate(PIKE, motion, values=WATERS[water], free=way) for way in (None, trim))
    if plane.message or free.message:
        raise SystemExit(plane.message or free.message)
    return Pair(plane, free)


def fast_start() -> JointMotion:
    """Return a C-start: all joints bend to one side, to the other, and straighten; quintic between the knots."""
    knots, bends = (np.array(row) for row in _FAST)
    time = grid(knots, STEP)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)
    piece = np.clip(np.searchsorted(knots, stages[:, 1]) - 1, 0, len(knots) - 2)[:, None]
    width, rise = np.diff(knots)[piece], np.diff(bends)[piece]
    s = (stages - knots[piece]) / width
    smooth = (
        bends[piece] + rise * s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        rise / width * 30.0 * s**2 * (1.0 - s) ** 2,
        rise / width**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )
    return JointMotion(time, *(np.repeat(part[..., None], PIKE.joints, axis=2) for part in smooth))
