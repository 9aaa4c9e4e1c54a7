"""The least-squares problem as plain functions of a vector, for an optimiser of one's own.

from scipy.optimize import least_squares

residual, jacobian, names, start, low, high = residual_function(dataset)
found = least_squares(residual, start, jac=jacobian, bounds=(low, high), x_scale="jac")
print(dict(zip(names, found.x)))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mjfish.data import Dataset
from mjfish.errors import InputError, UnknownNameError
from mjfish.estimation.clocks import aligned
from mjfish.estimation.nominal import first_sigma, nominal_problem, white
from mjfish.execution import executing
from mjfish.noise import Noise
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.parameters import bounds

Function = Callable[[FloatArray], FloatArray]


class ResidualFunction(NamedTuple):
    """A least-squares problem, in the order in which scipy asks for it.

    Attributes:
        residual: x (p,) to the whitened residuals (n,): measured - predicted over sigma, all trials and channels. Half
            their sum of squares is the cost; those of a trial that diverges are large and finite.
        jacobian: x (p,) to their exact derivative (n, p) by x.
        names: of the parameters (p,), e.g. ``c_d.head``.
        start: (p,).
        low: (p,) bounds; beyond them the model is not meant to be.
        high: (p,).
    """

    residual: Function
    jacobian: Function
    names: tuple[str, ...]
    start: FloatArray
    low: FloatArray
    high: FloatArray


def residual_function(
    dataset: Dataset,
    *,
    fixed: Mapping[str, float] | None = None,
    noise: FloatArray | None = None,
    jobs: int = 1,
) -> ResidualFunction:
    """Return the residuals of the nominal model on the trials that are fitted, [Yu2016] eq. (21); see above.

    Args:
        dataset: its held-out trials are left out.
        fixed: coefficients that are not free, with their values.
        noise: sigma (3,) of surge, sway [m/s], yaw rate [rad/s] that the residuals are divided by; None: the one that
            the dataset states, else a first one from the differences of its samples.
        jobs: threads.

    Raises:
        UnknownNameError: a name in `fixed` is no coefficient.
        InputError, ParameterError: `noise` is no sigma, a fixed value is outside its bounds.
    """
    trials, _ = aligned(dataset).split()
    given = dict(fixed or {})
    known = {p.name: p for p in (*dataset.fish.parameters, *dataset.fish.numbers)}
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError("coefficient", name, known)
        known[name].check(value)
    if noise is None:
        noise = white(dataset.noise if dataset.noise is not None else first_sigma(trials)).sigma
    sigma = np.asarray(noise, dtype=np.float64)
    if sigma.shape != (3,) or not np.all((sigma > 0.0) & np.isfinite(sigma)):
        raise InputError(f"noise is {sigma.tolist()}, expected three numbers above 0: surge, sway, yaw rate")
    problem = replace(nominal_problem(dataset, trials, Noise.white(readonly(sigma))), fixed=given)
    parameters = problem.parameters
    low, high = map(readonly, bounds(parameters))

    def at(x: FloatArray, made: Callable[[FloatArray], FloatArray]) -> FloatArray:
        x = np.asarray(x, dtype=np.float64)
        if x.shape != low.shape:
            raise InputError(
                f"x has shape {x.shape}, expected ({len(low)},): one number a parameter, in order of names"
            )
        with executing(jobs):
            return made(x)

    return ResidualFunction(
        residual=lambda x: at(x, problem.residual),
        jacobian=lambda x: at(x, lambda x: -problem.jacobian(x).dense()),
        names=tuple(p.name for p in parameters),
        start=readonly(problem.start()),
        low=low,
        high=high,
    )
