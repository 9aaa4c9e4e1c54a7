"""A swim of the pike with and without a cause, and the fit from which a form is drawn as a curve."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from mjfish.data import Dataset, Tank, Trial
from mjfish.diagnosis.curves import MeasuredCurve, curves_of
from mjfish.diagnosis.refit_result import Refit
from mjfish.drive import modes
from mjfish.effects import Effect
from mjfish.estimation import Noise, fit
from mjfish.estimation.nominal import nominal_problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.parameters import Parameter

#: Two speeds of the beat, and a turn: the runs in which causes are shown.
MODES = ("v1", "v3", "v1-t1")
DURATION, RATE = 6.0, 50.0
#: Noise of the camera [m/s, rad/s].
SIGMA = (0.005, 0.005, 0.03)
#: Root mean square of what a cause changes, over that of the swim, by which it is drawn.
CHANGE = 0.1
#: How far beyond its scale an amplitude is tried.
_LARGEST = 1e4


@dataclass(frozen=True, eq=False)
class Swim:
    """A run with and without a cause.

    Attributes:
        values: of the cause's parameters, by name.
        trial: the run, without velocities.
        nominal, changed: velocities (n, 3) of the nose.
    """

    values: dict[str, float]
    trial: Trial
    nominal: FloatArray
    changed: FloatArray


@functools.cache
def blank(mode: str) -> Trial:
    """Return a run of a mode in a tank, of which velocities are not known."""
    time = readonly(np.arange(int(DURATION * RATE) + 1) / RATE)
    still = readonly(np.zeros((len(time), 3)))
    tank = Tank((-0.3, 4.0), (-0.35, 0.35))
    roll = readonly(0.05 * np.sin(18.0 * time))
    return Trial(mode, "fit", time, still, modes.drive(mode), pose=still, roll=roll, tank=tank)


def swim(effect: Effect, mode: str = MODES[0]) -> Swim:
    """Return a run that a cause changes by `CHANGE`, or by as much as its bounds allow."""
    trial = blank(mode)
    model = Model(load_fish("pike"), (effect,))
    (own,) = model.effects
    nominal = model.predict(trial, model.values({})).velocity
    low, high = 0.0, 1.0
    while high < _LARGEST and _change(model, trial, _sizes(own, high), nominal) < CHANGE:
        low, high = high, 2.0 * high
    for _ in range(12):
        middle = 0.5 * (low + high)
        if _change(model, trial, _sizes(own, middle), nominal) < CHANGE:
            low = middle
        else:
            high = middle
    values = _sizes(own, low)
    return Swim(values, trial, nominal, model.predict(trial, model.values(values)).velocity)


def _sizes(effect: Effect, factor: float) -> dict[str, float]:
    """Return parameters a factor of their scales from the null; shapes as they are declared."""
    return {p.name: _moved(p, factor) for p in effect.amplitudes()} | {
        p.name: p.start for p in effect.parameters if p.shape
    }


def _moved(p: Parameter, factor: float) -> float:
    towards = -1.0 if p.default >= p.high else 1.0
    return min(max(p.default + towards * factor * p.scale, p.low), p.high)


def _change(model: Model, trial: Trial, values: dict[str, float], nominal: FloatArray) -> float:
    """Return the root mean square of the change over that of the swim, every velocity in units of its noise."""
    predicted = model.predict(trial, model.values(values))
    if predicted.status != "ok" or not np.all(np.isfinite(predicted.velocity)):
        return np.inf
    wrong = (predicted.velocity - nominal) / SIGMA
    return float(np.sqrt(np.mean(wrong**2) / np.mean((nominal / SIGMA) ** 2)))


def curves(effect: Effect) -> tuple[MeasuredCurve, ...]:
    """Return the curves of a cause of the size that `swim` has, as a fit to runs of all `MODES` would band them."""
    fish, shown = load_fish("pike"), swim(effect)
    model = Model(fish, (effect,))
    trials = []
    for mode in MODES:
        trial = blank(mode)
        velocity = model.predict(trial, model.values(shown.values)).velocity
        trials.append(replace(trial, velocity=readonly(velocity)))
    dataset = Dataset("gallery", fish, tuple(trials), noise=readonly(SIGMA))
    nominal = nominal_problem(dataset, dataset.trials, Noise.white(np.array(SIGMA)))
    before = fit(nominal, evaluations=1)
    problem = replace(nominal, model=model)
    found = fit(problem, problem.start({**fish.values, **shown.values}), evaluations=1)
    refit = Refit(model.effects, problem, found, before.sse - found.sse)
    return curves_of(effect.mechanism, refit, before)
