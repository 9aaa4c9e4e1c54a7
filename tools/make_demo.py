"""Makes the datasets that ship with the package (mjfish/demo); they hold what `mjfish demo` is to find out.

Run it from the repository: python tools/make_demo.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mjfish.data import Dataset, save
from mjfish.effects import Effect, find
from mjfish.effects.mechanism import Domain
from mjfish.fish import load_fish
from mjfish.hydro.load import Load, load
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.numerics.compiled import inlined
from mjfish.parameters import Parameter
from mjfish.simulation.synthetic import generate

FOLDER = Path(__file__).parents[1] / "mjfish" / "demo"
NOISE = np.array([0.01, 0.01, 0.05])
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
TAIL = {"tail_compliance.compliance": 0.09, "tail_compliance.damping": 0.03}
#: How much larger drag coefficients are at rest, and the speed at which half of that is left [m/s].
RISE, MIDDLE = 1.5, 0.8


@inlined
def excess(speed: Any) -> Any:
    """Return c(V) / c - 1 of the demo of a learned form, per unit of its size."""
    return 1.0 / (1.0 + (speed / MIDDLE) ** 2)


@load
def _excess_drag(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the constant coefficients, strip by strip."""
    across = 0.0
    moment = 0.0
    for k in range(link.strip_r.shape[0]):
        q = link.v + link.w * link.strip_r[k]
        share = link.strip_weight[k] * link.strip_height[k] * excess(q) * abs(q) * q
        across += share
        moment += share * link.strip_r[k]
    along = excess(link.u) * link.c_f * link.wetted * abs(link.u) * link.u
    size = -0.5 * link.density * parameters[0]
    return size * along, size * link.c_d * across, size * link.c_d * moment


class FallingDrag(Effect):
    """Drag coefficients fall with the local speed as no formula of the catalogue does: c (1 + a / (1 + (V / V_0)^2)).

    The catalogue must not have it: the form is to be learned.
    """

    name: ClassVar[str] = "falling_drag"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "drag_law"
    summary: ClassVar[str] = "drag coefficients fall around a speed"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("falling_drag.size", "-", 0.0, 0.0, 5.0, 0.0, 0.2, about="relative rise of the coefficients at rest"),
    )
    source: ClassVar[str] = "a drag crisis that is smeared out"
    signature: ClassVar[str] = "forward speed against beat frequency is bent"
    confirm: ClassVar[str] = "tow the stretched fish at several speeds"
    load: ClassVar[Load | None] = _excess_drag


def coefficient(name: str, speed: FloatArray) -> FloatArray:
    """Return the planted c_d or c_f (n,) of a group at speeds (n,), by its name, `c_d.head` say."""
    factors = [1.0 + RISE * excess(float(v)) for v in speed]
    return COEFFICIENTS[name] * np.array(factors)


def tail_demo() -> Dataset:
    """Return the first demo: a tail that gives way."""
    return generate(
        load_fish("pike"),
        ["v1", "v5", "v1-v5", "v3-t1", "v7", "v1-t2"],
        values={**COEFFICIENTS, **TAIL},
        effects=[find("tail_compliance")],
        noise=NOISE,
        seed=20261121,
        held_out=["v7", "v1-t2"],
        name="demo: a pool session with a robotic pike",
    )


def learned_demo() -> Dataset:
    """Return the demo of a learned form: drag that falls with the speed."""
    return generate(
        load_fish("pike"),
        ["v1", "v7", "v3-t1", "v5-v1", "v1-t2"],
        values={**COEFFICIENTS, "falling_drag.size": RISE},
        effects=[FallingDrag()],
        noise=NOISE,
        duration=7.2,
        seed=20261124,
        held_out=["v5-v1", "v1-t2"],
        name="demo: another pool session with a robotic pike",
    )


def make(folder: Path = FOLDER) -> None:
    """Write both datasets, the second one to the subfolder `learned`."""
    for dataset, place in ((tail_demo(), folder), (learned_demo(), folder / "learned")):
        rounded = [replace(trial, velocity=readonly(np.round(trial.velocity, 5))) for trial in dataset.trials]
        save(replace(dataset, trials=tuple(rounded)), place)


if __name__ == "__main__":
    make()
