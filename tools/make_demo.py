"""Makes the datasets that ship with the package (mjfish/demo, mjfish/demo/learned): what `mjfish demo` is to find out.

Run it from the repository: python tools/make_demo.py
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset, save
from mjfish.effects import Effect, find
from mjfish.effects.mechanism import Domain
from mjfish.fish import load_fish
from mjfish.hydro.load import Load, load
from mjfish.parameter import Parameter
from mjfish.simulation.synthetic import generate

FOLDER = Path(__file__).parents[1] / "mjfish" / "demo"
COEFFICIENTS = {
    "c_m.head": 0.62,
    "c_m.body": 0.35,
    "c_m.tail": 0.48,
    "c_d.head": 1.9,
    "c_d.body": 1.2,
    "c_d.tail": 1.6,
    "c_f.head": 0.011,
    "c_f.body": 0.009,
    "c_f.tail": 0.014,
}
#: Speed in the middle of the fall of the drag [m/s], and how steep it is.
MIDDLE, STEEP = 1.2, 4.0


def rise(speed: FloatArray | float, size: float) -> Any:
    """Return c(V) / c - 1 of the second demo: c(V) falls by a factor of 1 + size around `MIDDLE`."""
    return size / (1.0 + (np.abs(speed) / MIDDLE) ** STEEP)


@load
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the constant coefficients, strip by strip."""
    across = 0.0
    moment = 0.0
    for k in range(link.strip_r.shape[0]):
        r = link.strip_r[k]
        q = link.v + link.w * r
        factor = parameters[0] / (1.0 + (abs(q) / MIDDLE) ** STEEP)
        share = link.strip_weight[k] * link.strip_height[k] * factor * abs(q) * q
        across += share
        moment += share * r
    along = parameters[0] / (1.0 + (abs(link.u) / MIDDLE) ** STEEP) * link.c_f * link.wetted * abs(link.u) * link.u
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


class FallingDrag(Effect):
    """Drag coefficients fall with the local speed: a drag crisis that the sections do not have all at once."""

    name: ClassVar[str] = "falling_drag"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "drag_law"
    summary: ClassVar[str] = "drag coefficients fall around a speed"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("falling_drag.size", "-", 0.0, 0.0, 5.0, 0.0, 0.2, about="relative rise of the coefficients at rest"),
    )
    source: ClassVar[str] = "Hoerner, Fluid-Dynamic Drag (1965), ch. 3"
    signature: ClassVar[str] = "forward speed against beat frequency is bent"
    confirm: ClassVar[str] = "tow the stretched fish at several speeds"
    load: ClassVar[Load | None] = _excess
