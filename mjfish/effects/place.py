"""Where a run begins: what causes that depend on the place must know."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset, Trial


def unplaced(dataset: Dataset) -> str:
    """Say which trials have no measured place and heading at their start; empty where all have."""
    lost = [t.name for t in dataset.trials if t.pose is None or not np.isfinite(t.pose[0]).all()]
    return f"the place in the tank was not measured (no x, y, yaw columns) in {', '.join(lost)}" if lost else ""


def begun_at(trial: Trial) -> FloatArray:
    """Return x, y [m] and yaw [rad] (3,) with which the rollout begins; what was not measured is 0."""
    return np.zeros(3) if trial.pose is None else np.nan_to_num(trial.pose[0])
