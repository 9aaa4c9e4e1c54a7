"""Which samples of a trial count: predictions are drawn where they are scored."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis import Diagnosis, Overlay
from mjfish.estimation import Noise, Problem


def counted(diagnosis: Diagnosis, overlay: Overlay, predicted: FloatArray) -> FloatArray:
    """Return predicted velocities (n, 3), NaN where no fit and no score looks (see `mjfish.estimation.Problem.mask`).

    That is beside a step of the drive and, where joint angles were measured, near both ends of the trial.
    """
    problem = Problem(diagnosis.nominal_model, (overlay.trial,), Noise.white(np.ones(3)))
    return np.where(problem.mask(0)[:, None], predicted, np.nan)
