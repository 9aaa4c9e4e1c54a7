"""What every smooth cause of body and water must do: exact sensitivities, and a size that a fit finds again."""

from __future__ import annotations

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.model.sensitivity import one_sided, sensitivities
from mjfish.numerics.arrays import FloatArray
from mjfish.simulation.synthetic import generate

#: Off every bound.
VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.014, 0.01, 0.012), strict=True))
#: Sizes that a calm experimenter would call plain: some scales.
SIZES: dict[str, dict[str, float]] = {
    "inertia_error": {"error": 0.25},
    "com_offset": {"shift": -0.02},
    "section_height": {"error": 0.2},
    "mass_error": {"error": -0.15},
    "linear_drag": {"along": 1.2, "across": 120.0},
    "fin_lift": {"slope": 0.4},
    "reynolds_drag": {"friction": 1.2, "pressure": 0.8},
    "munk_moment": {"kappa": 0.8},
}
#: What must be known, from a tow test, where a refit would absorb nearly all.
KNOWN = {
    "section_height": ("c_d.head", "c_d.body", "c_d.tail", "c_m.tail"),
    "mass_error": ("c_d.tail",),
}
SIGMA = np.array([0.006, 0.006, 0.04])
#: Central differences of eighth order.
EIGHTH = ((1, 0.8), (2, -0.2), (3, 4.0 / 105.0), (4, -1.0 / 280.0))
EACH = [(name, short) for name, own in SIZES.items() for short in own]


def _full(name: str, share: float = 1.0) -> dict[str, float]:
    return {f"{name}.{short}": share * value for short, value in SIZES[name].items()}


def _trial(mode: str, seconds: float) -> Trial:
    time = np.arange(round(50 * seconds) + 1) / 50.0
    return Trial(mode, None, time, np.zeros((len(time), 3)), drive=modes.drive(mode))


def _apart(trial: Trial) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which samples are no kinks of the prediction in time: the start, and a step of the drive."""
    return np.all([np.abs(trial.time - segment.start) > 0.01 for segment in trial.drive], axis=0)


@pytest.mark.parametrize("share", [1.0, 0.0], ids=["true", "null"])
@pytest.mark.parametrize(("name", "short"), EACH)
def test_sensitivities_are_differences_of_whole_predictions(pike: Fish, name: str, short: str, share: float) -> None:
    """At a plain size and at the null; there a load that may only rise is compared on its one side."""
    effect = find(name)
    model, trial, full = Model(pike, (effect,)), _trial("v1-t2", 6.2), f"{name}.{short}"
    values = {**VALUES, **_full(name, share)}
    exact = sensitivities(model, trial, values, [full])[:, :, 0]
    p = effect.declaration(short)

    def at(shift: float) -> FloatArray:
        return model.predict(trial, {**values, full: values[full] + shift}).velocity

    if share == 0.0 and p.low == p.default:
        h = 0.05 * p.scale
        expected = (-25.0 * at(0.0) + 48.0 * at(h) - 36.0 * at(2 * h) + 16.0 * at(3 * h) - 3.0 * at(4 * h)) / (12.0 * h)
    else:
        h = 2e-3 * p.scale
        expected = np.asarray(sum(w * (at(k * h) - at(-k * h)) for k, w in EIGHTH)) / h
    kept = _apart(trial)
    worst = np.abs(exact - expected)[kept].max(axis=0) / np.abs(expected)[kept].max(axis=0)
    assert worst.max() < 1e-6, worst
    assert not one_sided(model, full, values[full])


@pytest.mark.parametrize("name", SIZES)
def test_a_fit_finds_the_true_size(pike: Fish, name: str) -> None:
    """Within four standard errors, and four from none. Catches a prediction and a generator that differ in a sign."""
    truth, effect = {**VALUES, **_full(name)}, find(name)
    dataset = generate(
        pike, ["v1", "v7", "v3-t2"], values=truth, effects=[effect], noise=SIGMA, duration=6.0, seed=20261121
    )
    known = {key: VALUES[key] for key in KNOWN.get(name, ())}
    problem = Problem(Model(pike, (effect,)), dataset.trials, Noise.white(SIGMA), fixed=known)
    found = fit(problem, problem.start({key: 1.2 * value for key, value in VALUES.items()}), tolerance=1e-6)
    assert found.status == "converged"
    for full, size in _full(name).items():
        estimate, sigma = found.values[full], found.sigma[full]
        assert abs(estimate - size) < 4.0 * sigma
        assert abs(estimate) > 4.0 * sigma > 0.0


@pytest.mark.parametrize("name", SIZES)
def test_the_true_size_is_significant_before_a_refit(pike: Fish, name: str) -> None:
    """Against noise of 6 mm/s and 0.04 rad/s: an rms of more than twice the noise in some channel."""
    effect = find(name)
    model, trial = Model(pike, (effect,)), _trial("v7", 6.0)
    nominal = model.predict(trial, model.values(VALUES)).velocity
    for full, size in _full(name).items():
        other = model.predict(trial, model.values({**VALUES, full: size})).velocity
        assert (np.sqrt(np.mean((other - nominal) ** 2, axis=0)) / SIGMA).max() > 2.0


@pytest.mark.parametrize("name", SIZES)
def test_at_every_bound_the_fish_still_swims(pike: Fish, name: str) -> None:
    """A fit may look anywhere between the bounds."""
    effect = find(name)
    model, trial = Model(pike, (effect,)), _trial("v7", 3.0)
    for p in effect.parameters:
        for value in (p.low, p.high):
            assert model.predict(trial, model.values({**VALUES, p.name: value})).status == "ok", (p.name, value)
