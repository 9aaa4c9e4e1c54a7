"""The least-squares problem of the nominal model of a dataset, a first noise, and the problem as plain functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.sensor import first_sensor_sigma
from mjfish.effects import catalogue
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.estimation import clocks
from mjfish.estimation.problem import Problem, nuisances
from mjfish.execution import executing
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.model import Model
from mjfish.noise import Noise
from mjfish.noise.autoregressive import FLOOR, floor
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.parameters import Parameter, bounds


def nominal_problem(
    dataset: Dataset,
    trials: tuple[Trial, ...],
    noise: Noise,
) -> Problem:
    """Return the problem of a dataset's fish on some of its trials.

    A cause of whose parameters something is known (`Dataset.known`) is a part of the nominal model.

    Args:
        dataset: with the fish, and what is known.
        trials: of it, that are fitted.
        noise: gives the weights.

    Raises:
        UnknownNameError: something is known of a number that there is not.
        InputError, ParameterError: what is known contradicts itself.
    """
    given = _parameter_priors(dataset)
    known = (effect for name, effect in catalogue().items() if any(key.startswith(f"{name}.") for key in given))
    model = Model(dataset.fish, tuple(known))
    problem = Problem(
        model,
        trials,
        noise,
        free_clock=dataset.clock == "free",
        smoothing=dataset.filter,
        nominal=tuple(effect.name for effect in model.effects),
        sensor_sigma=_first_sensor_sigma(dataset, trials),
    )
    if not given:
        return problem
    own = (p for trial in dataset.trials for p in nuisances(trial, problem.free_clock))
    waves = [trial for trial in dataset.trials if trial.wave is not None]
    scales = [clocks.SCALE, *(f"{trial.name}:{clocks.SCALE}" for trial in waves)] if waves else []
    with located(f"{dataset.source or dataset.name}: known"):
        return replace(problem, declared=_declared(given, [*model.parameters, *own, *map(clocks.scale, scales)]))


def _first_sensor_sigma(dataset: Dataset, trials: tuple[Trial, ...]) -> dict[str, FloatArray]:
    """Return the first sigma of every sensor that states none, of the trials that are fitted if they have it."""
    found = {}
    for name in dict.fromkeys(s.name for trial in dataset.trials for s in trial.sensors if s.sigma is None):
        fitted, every = ([s for t in some for s in t.sensors if s.name == name] for some in (trials, dataset.trials))
        found[name] = first_sensor_sigma(fitted or every, FLOOR)
    return found


def _parameter_priors(dataset: Dataset) -> dict[str, ParameterPrior]:
    """Return what is known of parameters: as the dataset says, and by how it was taken."""
    taken = (effect.parameter_priors(dataset) for effect in catalogue().values())
    return {**{name: known for own in taken for name, known in own.items()}, **dataset.known}


def _declared(given: Mapping[str, ParameterPrior], parameters: Sequence[Parameter]) -> dict[str, Parameter]:
    """Return the declarations of the parameters of which something is known, by name."""
    declared: dict[str, Parameter] = {}
    for pattern, known in given.items():
        found = [p for p in parameters if p.name == pattern or fnmatchcase(p.name, pattern)]
        if not found:
            raise UnknownNameError("parameter", pattern, [p.name for p in parameters])
        declared.update({p.name: known.of(p) for p in found})
    return declared


def first_sigma(trials: tuple[Trial, ...]) -> FloatArray:
    """Return a first sigma (3,) where none is stated: of the third differences of the measurements.

    For white noise their variance is 20 sigma^2; what is left of a smooth motion in them only makes sigma larger. NaN
    of a channel that no trial measured.
    """
    differences = np.concatenate([np.diff(trial.velocity, n=3, axis=0) for trial in trials])
    with np.errstate(invalid="ignore"):  # of a channel without any
        squares = np.nansum(differences**2, axis=0) / np.count_nonzero(np.isfinite(differences), axis=0)
    return np.asarray(np.maximum(np.sqrt(squares / 20.0), floor(trials)))


def white(sigma: FloatArray) -> Noise:
    """Return white noise of sigma (3,); residuals of a channel without one, which nobody measured, are zero."""
    return Noise.white(np.where(np.isnan(sigma), 1.0, sigma))


def check_enough(problem: Problem, name: str) -> None:
    """Refuse a problem of the dataset `name` where a trial has nothing to fit, or all have too little.

    Raises:
        InputError: no sample of a trial counts, or there are no more numbers than free parameters.
    """
    for i, trial in enumerate(problem.trials):
        if not problem.mask(i).any() and not trial.sensors:
            raise InputError(
                f"{name}: no sample of trial '{trial.name}' counts: it ends within what is left out at the ends of a "
                "recording and beside steps of the drive; record longer, or leave the trial out"
            )
    samples, free = problem.numbers, len(problem.parameters)
    if samples <= free:
        raise InputError(f"{name}: {samples} numbers for {free} free parameters; give more data, or fix parameters")


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
    """Return the least-squares problem of a dataset as plain functions of a vector, for an optimiser of one's own.

    Residuals are those of the nominal model on the trials that are fitted, [Yu2016] eq. (21).

    Args:
        dataset: its held-out trials are left out.
        fixed: coefficients that are not free, with their values.
        noise: sigma (3,) of surge, sway [m/s], yaw rate [rad/s] that the residuals are divided by; None: the one that
            the dataset states, else a first one from the differences of its samples.
        jobs: threads.

    Raises:
        UnknownNameError: a name in `fixed` is no coefficient.
        InputError, ParameterError: `noise` is no sigma, a fixed value is outside its bounds.

    Example:
        from scipy.optimize import least_squares

        residual, jacobian, names, start, low, high = residual_function(dataset)
        found = least_squares(residual, start, jac=jacobian, bounds=(low, high), x_scale="jac")
        print(dict(zip(names, found.x)))
    """
    trials, _ = clocks.aligned(dataset).split()
    given = dict(fixed or {})
    known = {p.name: p for p in (*dataset.fish.parameters, *dataset.fish.numbers)}
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError("coefficient", name, known)
        known[name].check(value)
    stated = dataset.noise if dataset.noise is not None else first_sigma(trials)
    sigma = np.asarray(white(stated).sigma if noise is None else noise, dtype=np.float64)
    if sigma.shape != (3,) or not np.all((sigma > 0.0) & np.isfinite(sigma)):
        raise InputError(f"noise is {sigma.tolist()}, expected three numbers above 0: surge, sway, yaw rate")
    problem = replace(nominal_problem(dataset, trials, Noise.white(readonly(sigma))), fixed=given)
    low, high = map(readonly, bounds(problem.parameters))

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
        names=tuple(p.name for p in problem.parameters),
        start=readonly(problem.start()),
        low=low,
        high=high,
    )
