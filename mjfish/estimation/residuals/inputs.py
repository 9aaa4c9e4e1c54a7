"""What drives the fish, as inputs that a residual may depend on: the command of the last moving joint, with lags."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.estimation.residuals.residual import Residual
from mjfish.fish import Cpg
from mjfish.model import asked_motion
from mjfish.ode.rollout import STEP

#: Inputs by name, from the angle of the last joint that moves [rad].
INPUTS: dict[str, Callable[[FloatArray], FloatArray]] = {"beat": lambda angle: angle, "double_beat": np.square}
#: Lags of the residual behind the input [s]: both signs, for a clock may be ahead.
LAG = np.linspace(-0.5, 0.5, 51)
#: Directions below these shares of the largest singular value: not tested; not even in the bands.
_MAIN, _ALL = 0.1, 0.01


@dataclass(frozen=True, eq=False)
class Lagged:
    """An input at all lags, U = basis loading (n, l).

    Attributes:
        lag: (l,) [s].
        basis: (n, d) orthonormal, strongest direction first; zero where no sample counts.
        loading: (d, l).
        main: number of directions that matter.
        power: (l,) sum of squares of the input over the samples that count.
    """

    lag: FloatArray
    basis: FloatArray
    loading: FloatArray
    main: int
    power: FloatArray


def lagged(cpg: Cpg | None, residual: Residual, name: str) -> Lagged:
    """Return an input of a trial at all lags; before the start and after the end its value there goes on.

    The input is zero, without a direction, where no joint moves.
    """
    motion = asked_motion(cpg, residual.trial, STEP)
    there = np.all(np.isfinite(residual.values), axis=1)
    when = np.clip(residual.trial.time[:, None] - LAG, motion.time[0], motion.time[-1])
    angles = motion.angle_at(when.ravel())
    moving = np.flatnonzero(np.ptp(angles, axis=0) > 0.0)
    angle = angles[:, moving[-1] if len(moving) else -1].reshape(when.shape)
    angle = angle if len(moving) else np.zeros(when.shape)
    values = INPUTS[name](angle) * there[:, None]
    left, singular, right = np.linalg.svd(values, full_matrices=False)
    kept = (singular > _ALL * singular[0]) & (singular > 0.0)
    return Lagged(
        lag=LAG,
        basis=left[:, kept],
        loading=singular[kept, None] * right[kept],
        main=int(np.count_nonzero(singular[kept] > _MAIN * singular[0])),
        power=np.asarray(np.sum(values**2, axis=0)),
    )
