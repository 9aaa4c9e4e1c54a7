"""The beat of a periodic motion."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from mjfish.arrays import FloatArray

#: Frequencies among which the beat is searched [Hz].
_SLOWEST, _FASTEST = 0.15, 6.0
#: Share of a motion's variance that a beat with one overtone must explain.
_PERIODIC = 0.7


def frequency(time: FloatArray, lateral: FloatArray) -> tuple[float, bool]:
    """Return the frequency [Hz] that, with a drift, leaves the least of a motion (n,), and whether it is a beat."""
    share = time / max(float(np.ptp(time)), 1e-9)

    def left(trial: float, harmonics: int = 1) -> float:
        phase = 2.0 * np.pi * trial * time
        waves = [wave(k * phase) for k in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
        design = np.column_stack([np.ones_like(time), share, *waves])
        return float(np.square(lateral - design @ np.linalg.lstsq(design, lateral)[0]).sum())

    slowest = max(_SLOWEST, 1.0 / float(np.ptp(time)))
    step = 0.1 / float(np.ptp(time))
    trials = np.arange(slowest, _FASTEST, step)
    best = float(trials[int(np.argmin([left(trial) for trial in trials]))])
    refined = float(minimize_scalar(left, bounds=(max(best - step, 0.5 * slowest), best + step), method="bounded").x)
    periodic = left(refined, 2) < (1.0 - _PERIODIC) * max(left(refined, 0), 1e-300)
    return refined, periodic
