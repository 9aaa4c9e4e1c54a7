"""Where a run begins: what causes that depend on the place must know."""

from __future__ import annotations

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.numerics.arrays import FloatArray


def unplaced(dataset: Dataset) -> str:
    """Say which trials have no measured place and heading at their start; empty where all have."""
    lost = [t.name for t in dataset.trials if not np.isfinite(_first(t)).all()]
    return f"the place in the tank was not measured (no x, y, yaw) in {', '.join(lost)}" if lost else ""


def heading_known(trial: Trial) -> bool:
    """Return whether the heading in the world was measured."""
    return trial.pose is not None or bool(np.isfinite(_first(trial)[2]))


def begun_at(trial: Trial) -> FloatArray:
    """Return x, y [m] and yaw [rad] (3,) with which the rollout begins; what was not measured is 0."""
    return np.nan_to_num(_first(trial))


def _first(trial: Trial) -> FloatArray:
    """Return x, y, yaw (3,) of the first samples of poses, or of sensors of a place and a heading; NaN without any."""
    found = np.full(3, np.nan) if trial.pose is None else trial.pose[0].copy()
    for sensor in trial.sensors:
        at = {"position": slice(0, 2), "heading": slice(2, 3)}.get(sensor.kind)
        if at is not None and np.isnan(found[at]).all():
            found[at] = sensor.values[0]
    return found
