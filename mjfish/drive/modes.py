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

_STRAIGHT = (0.0, 0.0, 0.0, 0.0)
_TURNS = {"t1": (0.0, 0.5, 1.0, 1.5), "t2": (0.0, 1.0, 1.5, 2.0)}

MODES = ("v1", "v3", "v5", "v7", "v1-v5", "v5-v1", "v1-t1", "v1-t2", "v3-t1", "v3-t2")


def drive(mode: str) -> tuple[DriveSegment, ...]:
    """Return the drive of a mode of Table IV: ``vx`` is omega = 16 + 2 x rad/s, ``t1`` and ``t2`` are turns.

    Raises:
        UnknownNameError: no such mode.
    """
    from mjfish.drive.cpg import DriveSegment  # compiles; the names of the modes are had without

    if mode not in MODES:
        raise UnknownNameError("mode", mode, MODES)
    first, _, second = mode.partition("-")
    segments = [DriveSegment(0.0, _omega(first), _STRAIGHT)]
    if second.startswith("v"):
        segments.append(DriveSegment(CHANGE, _omega(second), _STRAIGHT))
    elif second:
        segments.append(DriveSegment(CHANGE, _omega(first), _TURNS[second]))
    return tuple(segments)


def _omega(speed: str) -> float:
    return 16.0 + 2.0 * float(speed[1:])
