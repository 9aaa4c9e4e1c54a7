"""The least-squares problem of the nominal model of a dataset, with what is known beforehand, and a first noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.sensor import first_sensor_sigma
from mjfish.effects import catalogue
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.estimation import clocks
from mjfish.estimation.problem import Problem, nuisances
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.model import Model
from mjfish.noise import Noise
from mjfish.noise.autoregressive import FLOOR, floor
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


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
    free_clock, nominal = dataset.clock == "free", tuple(effect.name for effect in model.effects)
    problem = Problem(
        model,
        trials,
        noise,
        free_clock=free_clock,
        smoothing=dataset.filter,
        nominal=nominal,
        sensor_sigma=_first_sensor_sigma(dataset, trials),
    )
    if not given:
        return problem
    own = (p for trial in dataset.trials for p in nuisances(trial, free_clock))
    waves = [trial for trial in dataset.trials if trial.wave is not None]
    scales = [clocks.SCALE, *(f"{trial.name}:{clocks.SCALE}" for trial in waves)] if waves else []
    with located(f"{dataset.source or dataset.name}: known"):
        return replace(problem, declared=_declared(given, [*model.parameters, *own, *map(clocks.scale, scales)]))


def _first_sensor_sigma(dataset: Dataset, trials: tuple[Trial, ...]) -> dict[str, FloatArray]:
    """Return the first sigma of every sensor that states none, of the trials that are fitted if they have it."""
    unstated = [s.name for trial in dataset.trials for s in trial.sensors if s.sigma is None]
    found = {}
    for name in dict.fromkeys(unstated):
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
    counted = [int(np.count_nonzero(problem.mask(i))) for i in range(len(problem.trials))]
    for trial, count in zip(problem.trials, counted, strict=True):
        if count == 0 and not trial.sensors:
            raise InputError(
                f"{name}: no sample of trial '{trial.name}' counts: it ends within what is left out at the ends of a "
                "recording and beside steps of the drive; record longer, or leave the trial out"
            )
    samples, free = problem.numbers, len(problem.parameters)
    if samples <= free:
        raise InputError(f"{name}: {samples} numbers for {free} free parameters; give more data, or fix parameters")
