"""Reading a log back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import RrdReader


def entities(path: Path) -> set[str]:
    """Return the paths of all entities."""
    return {str(column.entity_path) for column in RrdReader(path).store().schema().component_columns()}


def column(path: Path, entity: str, component: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (n,) [s] and values of one component of one entity over ``sim_time``."""
    times, values = [], []
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if {"sim_time", component} <= set(batch.schema.names):
            times.append(np.asarray(batch.column("sim_time").cast("int64")) * 1e-9)
            values.append(np.array(batch.column(component).to_pylist(), dtype=np.float64))
    return np.concatenate(times), np.concatenate(values)


def text(path: Path, entity: str, component: str) -> str:
    """Return a static text."""
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            return str(batch.column(component).to_pylist()[0][0])
    raise AssertionError(f"{entity} has no {component}")
