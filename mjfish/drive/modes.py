"""The ten swimming modes of [Yu2016], Table IV, as drive segments; changes happen at 5.2 s."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mjfish.errors import UnknownNameError

if TYPE_CHECKING:
    from mjfish.drive.cpg import DriveSegment

#: Length of a run in the paper's figures [s].
DURATION = 10.4
#: When the mode changes within a run [s].
CHANGE = 5.2

#: Biases of the four joints of the pike [-].
_TURNS = {"t1": (0.0, 0.5, 1.0, 1.5), "t2": (0.0, 1.0, 1.5, 2.0)}

MODES = ("v1", "v3", "v5", "v7", "v1-v5", "v5-v1", "v1-t1", "v1-t2", "v3-t1", "v3-t2")


def drive(mode: str, joints: int = 4) -> tuple[DriveSegment, ...]:
    """Return the drive of a mode of Table IV: ``vx`` is omega = 16 + 2 x rad/s, ``t1`` and ``t2`` are turns.

    The biases of a turn are those of the pike's four joints; of a fish with another number, they are taken between
    these, from the first joint to the last. One joint has that of the last.

    Args:
        mode: its name.
        joints: of the fish.

    Raises:
        UnknownNameError: no such mode.
    """
    from mjfish.drive.cpg import DriveSegment  # compiles; the names of the modes are had without

    if mode not in MODES:
        raise UnknownNameError("mode", mode, MODES)
    first, _, second = mode.partition("-")
    straight = (0.0,) * joints
    segments = [DriveSegment(0.0, _omega(first), straight)]
    if second.startswith("v"):
        segments.append(DriveSegment(CHANGE, _omega(second), straight))
    elif second:
        segments.append(DriveSegment(CHANGE, _omega(first), _stretched(_TURNS[second], joints)))
    return tuple(segments)


def _stretched(biases: tuple[float, ...], joints: int) -> tuple[float, ...]:
    """Return biases of so many joints between those of four."""
    last = len(biases) - 1
    places = [last * j / (joints - 1) for j in range(joints)] if joints > 1 else [float(last)]
    below = [min(int(place), last - 1) for place in places]
    return tuple(biases[k] + (place - k) * (biases[k + 1] - biases[k]) for place, k in zip(places, below, strict=True))


def _omega(speed: str) -> float:
    return 16.0 + 2.0 * float(speed[1:])
