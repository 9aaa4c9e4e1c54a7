"""The constant shift in time at which a rollout agrees best with the measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from mjfish.arrays import FloatArray
from mjfish.data import Trial

#: Shifts are looked for up to here [s], but not beyond half a beat: there, the next beat would fit again.
LONGEST = 0.25
#: Nor beyond this share of the trial: the ends of what is shifted are not compared.
_SHARE = 0.1
_GRID = 0.0025


@dataclass(frozen=True)
class Shift:
    """What is measured at t agrees best with the rollout at t + `time`, as in the effect ``time_offset``.

    Attributes:
        time: [s].
        rmse: that is left then, over the samples that the shifted rollout covers; NaN of several channels together.
        nrmse: the same over the range of the measurement; of several channels the root of their mean square.
        at_limit: whether the best shift is the largest that was tried, so that a larger one may be better.
    """

    time: float
    rmse: float
    nrmse: float
    at_limit: bool


def reach(trial: Trial) -> float:
    """Return the largest shift [s] that is tried."""
    half_beats = [np.pi / segment.omega for segment in trial.drive]
    return float(min(LONGEST, _SHARE * (trial.time[-1] - trial.time[0]), *half_beats))


def best_shift(
    predict: Callable[[FloatArray], FloatArray],
    time: FloatArray,
    measured: FloatArray,
    span: FloatArray,
    longest: float,
) -> Shift | None:
    """Return the shift with the least sum over the channels of (RMSE / range)^2.

    Args:
        predict: times (m,) to velocities (m, k), NaN where there are none.
        time: (n,) of the samples [s].
        measured: (n, k).
        span: (k,) range of each channel.
        longest: shift that is tried [s].

    Returns:
        The shift; None where fewer than two samples are covered at every shift, or a channel has no range.
    """
    ends = np.all(np.isfinite(predict(time - longest)) & np.isfinite(predict(time + longest)), axis=1)
    if np.count_nonzero(ends) < 2 or not np.all(span > 0.0):
        return None

    def cost(shift: float) -> float:
        """Over the same samples for every shift: at one end a run may be harder to meet than at the other."""
        return float(np.sum(np.nanmean(((measured - predict(time + shift))[ends] / span) ** 2, axis=0)))

    grid = np.linspace(-longest, longest, 2 * int(np.ceil(longest / _GRID)) + 1)
    costs = [cost(float(shift)) for shift in grid]
    best = int(np.argmin(costs))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-6})
    shift = float(refined.x if refined.fun < costs[best] else grid[best])
    left = measured - predict(time + shift)
    rmse = np.sqrt(np.nanmean(left**2, axis=0))
    return Shift(
        time=shift,
        rmse=float(rmse[0]) if len(rmse) == 1 else float("nan"),
        nrmse=float(np.sqrt(np.mean((rmse / span) ** 2))),
        at_limit=best in (0, len(grid) - 1),
    )
