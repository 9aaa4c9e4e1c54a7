"""Noise models from plain data, as `mjfish.estimation.Noise.to_dict` writes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mjfish.arrays import readonly
from mjfish.estimation import Noise, Problem
from mjfish.noise.coloured import Coloured
from mjfish.noise.differentiated import Differentiated
from mjfish.noise.drifting import Drifting
from mjfish.noise.forces import Pushed, along
from mjfish.noise.misread import Misread, Misreading
from mjfish.noise.stepwise import Stepwise

_PLAIN: dict[str, type[Noise]] = {kind.__name__: kind for kind in (Noise, Coloured, Differentiated, Drifting)}


def restore(saved: Mapping[str, Any], problem: Problem, values: Mapping[str, float]) -> Noise:
    """Return the noise model that was saved.

    Args:
        saved: of `Noise.to_dict`.
        problem: that the noise belongs to; its own noise does not matter.
        values: of its parameters: forces and errors of joint angles reach the velocities through the motion there.

    Raises:
        KeyError: an unknown kind, or a number is missing.
    """
    kind = saved["kind"]
    numbers: dict[str, Any] = {
        name: readonly(np.array(value, dtype=float).reshape(3, -1) if name == "phi" else np.array(value, dtype=float))
        if isinstance(value, list)
        else value
        for name, value in saved.items()
        if name not in ("kind", "base", "models")
    }
    if kind == Stepwise.__name__:
        return Stepwise.of({float(step): restore(one, problem, values) for step, one in saved["models"].items()})  # type: ignore[misc]
    if kind == Misread.__name__:
        return Misread.of(restore(saved["base"], problem, values), Misreading(problem, dict(values)))  # type: ignore[arg-type]
    if kind == Pushed.__name__:
        return Pushed(**numbers, growth=along(problem, values))
    return _PLAIN[kind](**numbers)
