"""The bodies that things are proved on: a plate, one as crooked as may be, a free chain."""

from __future__ import annotations

import numpy as np

from proofs.parts import Part


def plate(mass: float = 0.9, com: tuple[float, float, float] = (-0.15, 0.0, 0.0)) -> Part:
    """Return a free body of one elliptic section, its frame at the front end."""
    strips = {"length": 0.3, "height": 0.12, "width": 0.05, "c_d": 0.0, "c_f": 0.0}
    return Part("plate", joint="free", mass=mass, com=com, inertia=_diagonal(1.1e-3, 7e-3, 7.5e-3), strips=(strips,))


def _diagonal(*entries: float) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.diag(entries)))


#: One free body, as crooked as may be: tapering both ways, its com and its axes of inertia anywhere.
CROOKED = Part(
    "body",
    joint="free",
    mass=1.3,
    com=(-0.11, 0.012, -0.017),
    inertia=((4.1e-3, 3e-4, -7e-4), (3e-4, 9.2e-3, 5e-4), (-7e-4, 5e-4, 1.1e-2)),
    strips=(
        {
            "length": 0.32,
            "station": (0.0, 0.14, 0.32),
            "height": (0.04, 0.13, 0.07),
            "width": (0.05, 0.06, 0.015),
            "origin": (0.05, 0.01, 0.02),
            "axis": (-1.0, 0.15, -0.1),
            "up": (0.2, 0.3, 1.0),
            "c_m": 0.9,
            "c_d": 1.7,
            "c_f": 0.03,
            "munk_moment": 1.0,
            "roll_damping": 0.8,
        },
    ),
)


def chain() -> tuple[Part, ...]:
    """Return a free chain: a crooked head, a link at a ball joint with a dry fin at a hinge, two links at hinges."""
    slim = {
        "length": 0.2,
        "station": (0.0, 0.2),
        "height": (0.11, 0.05),
        "width": (0.05, 0.02),
        "c_m": 1.1,
        "c_d": 1.3,
        "c_f": 0.02,
        "munk_moment": 1.0,
    }
    inertia = ((6e-4, 1e-4, 0.0), (1e-4, 1.9e-3, -2e-4), (0.0, -2e-4, 2.2e-3))
    return (
        CROOKED,
        Part(
            "neck",
            "body",
            (-0.27, 0.02, 0.0),
            (0.95, 0.1, 0.2, -0.1),
            "ball",
            (0, 0, 1),
            0.6,
            (-0.09, 0.0, 0.01),
            inertia,
            (slim,),
        ),
        Part(
            "fin",
            "neck",
            (-0.1, 0.0, 0.05),
            (1.0, 0.3, 0.0, 0.1),
            "hinge",
            (1.0, 0.2, 0.1),
            0.1,
            (0.0, 0.02, 0.05),
            _diagonal(2e-4, 1e-4, 2e-4),
        ),
        Part(
            "waist",
            "neck",
            (-0.2, 0.0, 0.0),
            (1.0, 0.0, 0.0, 0.2),
            "hinge",
            (0.1, -0.2, 1.0),
            0.5,
            (-0.1, 0.01, 0.0),
            inertia,
            ({**slim, "up": (0.0, 0.4, 1.0), "c_d": 0.7},),
        ),
        Part(
            "tail",
            "waist",
            (-0.2, 0.01, 0.0),
            (1.0, 0.1, -0.2, 0.0),
            "hinge",
            (0.0, 0.1, 1.0),
            0.2,
            (-0.06, 0.0, 0.0),
            inertia,
            ({**slim, "height": (0.04, 0.12), "width": (0.02, 0.004)},),
        ),
    )
