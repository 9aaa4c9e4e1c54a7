"""Trials to predict: short, driven by the CPG, with nothing measured in them."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.numerics.arrays import readonly

STRAIGHT = (0.0, 0.0, 0.0, 0.0)


def blank(name: str, drive: tuple[DriveSegment, ...], *, duration: float = 3.0, rate: float = 50.0) -> Trial:
    """Return a trial whose velocities are all zero."""
    time = np.arange(round(duration * rate) + 1) / rate
    return Trial(name, None, readonly(time), readonly(np.zeros((len(time), 3))), drive)


@pytest.fixture(scope="session")
def straight() -> Trial:
    """Straight swimming."""
    return blank("straight", (DriveSegment(0.0, 18.0, STRAIGHT),))


@pytest.fixture(scope="session")
def turning() -> Trial:
    """A turn and a change of frequency at 1.5 s."""
    return blank("turning", (DriveSegment(0.0, 22.0, STRAIGHT), DriveSegment(1.5, 18.0, (0.0, 1.0, 1.5, 2.0))))
