"""Force of a cause of the water on one link, called as the engines call it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pike_coefficients import COEFFICIENTS

from mjfish.effects import Effect
from mjfish.fish import Fish
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, Load, LoadBuffers, load_rows, loads_on
from mjfish.numerics.arrays import FloatArray

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
LINKS = range(5)
#: u, v, w of a link: at rest, ahead, backing up, turning in place, and with a strip at rest within every link.
STATES = (
    (0.0, 0.0, 0.0),
    (-0.6, 0.15, 2.0),
    (-0.3, -0.4, -1.0),
    (0.2, 0.05, 3.0),
    (0.0, 0.0, 5.0),
    (-0.5, 0.1, -4.0),
    (-0.02, 0.004, -0.3),
)


def moving(fish: Fish, state: tuple[float, float, float]) -> Any:
    """Return the records of all links, each with this velocity."""
    records = link_records(fish, VALUES)
    records["u"], records["v"], records["w"] = state
    return records


def numbers(effect: Effect, values: Mapping[str, float]) -> list[float]:
    """Return what the load gets: parameters in declared order, `values` by short names, and what its fish gives."""
    given = [values.get(p.short, p.default) for p in effect.parameters]
    return [*given, *effect.constants(None)]  # type: ignore[arg-type]


def force(effect: Effect, values: Mapping[str, float], records: Any, link: int) -> FloatArray:
    """Return fx, fy, mz."""
    assert effect.load is not None
    return pushed(effect.load, numbers(effect, values), records, link)


def pushed(one: Load, own: Sequence[float], records: Any, link: int) -> FloatArray:
    """Return fx, fy, mz of a load without memory."""
    buffers = LoadBuffers(np.zeros(ANSWER), np.zeros(0), np.zeros(0))
    return np.array(loads_on(records, link, link, load_rows([(one, own)]), False, buffers))
