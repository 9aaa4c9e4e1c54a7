"""The amplitude of a beat that a link remembers, as a Keulegan-Carpenter number.

From the lateral velocity v of a point of the link, with y = s = 0 where the run begins,

    y' = v - y / tau,    s' = (y^2 - s) / tau,    A^2 = 2 s,    tau = 0.5 s
"""

from __future__ import annotations

import numpy as np

from mjfish.numerics.compiled import merged

#: KC of what has not moved yet: a power below zero has no value at zero, and a run begins at rest.
KC_FLOOR = 0.3
#: Time in which an amplitude is forgotten [s]. Some beats, so that it is one number over a beat: at 2 Hz the ripple of
#: the mean square is 8 %. Not many, so that a turn or a change of the beat is followed.
TAU = 0.5


@merged
def keulegan_carpenter(square: float, height: float) -> float:
    """Return KC of a section of this height whose way has this mean square; positive where a step goes below.

    KC^2 = KC_floor^2 + (2 pi A / h)^2, A^2 = 2 s.
    """
    return float(np.sqrt(max(KC_FLOOR**2 + 8.0 * np.pi**2 * square / (height * height + 1e-12), 1e-4)))
