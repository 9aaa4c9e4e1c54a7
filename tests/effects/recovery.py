"""Hides a cause in three short synthetic trials and fits its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pike_coefficients import COEFFICIENTS

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg
from mjfish.effects import Effect
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

#: Of surge, sway [m/s] and yaw rate [rad/s].
NOISE = np.array([0.006, 0.006, 0.04])
#: Away from the starts of a fit.
TRUTH = dict(zip(COEFFICIENTS, (0.6, 0.4, 0.7, 1.5, 1.2, 2.0, 0.012, 0.008, 0.011), strict=True))
#: Central differences of eighth order.
_EIGHTH = ((1, 0.8), (2, -0.2), (3, 4.0 / 105.0), (4, -1.0 / 280.0))


def synthetic(fish: Fish, effect: Effect, sizes: dict[str, float], *, seed: int = 3) -> Dataset:
    """Return three trials of 3 s of a fish with the cause; `sizes` by short names."""
    values = TRUTH | {f"{effect.name}.{short}": size for short, size in sizes.items()}
    return generate(
        fish, ["v1", "v3", "v7"], values=values, effects=[effect], noise=NOISE, duration=3.0, seed=seed
    )  # fmt: skip


def refitted(dataset: Dataset, effect: Effect, fixed: dict[str, float] | None = None) -> Fit:
    """Fit the nine coefficients and the cause."""
    problem = Problem(Model(dataset.fish, (effect,)), dataset.trials, Noise.white(NOISE), fixed=fixed or {})
    return fit(problem)


def deviations(found: Fit, effect: Effect, sizes: dict[str, float]) -> dict[str, float]:
    """Return how many standard deviations the fit is off the true sizes."""
    names = {short: f"{effect.name}.{short}" for short in sizes}
    return {short: (found.values[name] - sizes[short]) / found.sigma[name] for short, name in names.items()}


def strength(fish: Fish, effect: Effect, sizes: dict[str, float]) -> float:
    """Return the largest change of a channel that the cause makes, in units of the noise, without a refit."""
    clean, with_it = (
        generate(fish, ["v1", "v3"], values=values, effects=[effect], duration=3.0)
        for values in (TRUTH, TRUTH | {f"{effect.name}.{short}": size for short, size in sizes.items()})
    )
    change = [a.velocity - b.velocity for a, b in zip(with_it.trials, clean.trials, strict=True)]
    return float(np.max(np.sqrt(np.mean(np.concatenate(change) ** 2, axis=0)) / NOISE))


def found_again(fish: Fish, effect: Effect, sizes: dict[str, float], least: float = 1.0) -> Fit:
    """Return the fit to noisy data with the effect: it converges, within four standard deviations of what was planted.

    The effect is stronger than `least`, in units of the noise.
    """
    assert strength(fish, effect, sizes) > least
    found = refitted(synthetic(fish, effect, sizes), effect)
    assert found.status == "converged"
    planted = {short: size for short, size in sizes.items() if size}
    assert max(map(abs, deviations(found, effect, planted).values())) < 4.0
    return found


def with_measured_joints(fish: Fish, trial: Trial) -> Trial:
    """Return the trial with the angles that its joints were told as measured ones."""
    command = cpg.joint_motion(fish.cpg, trial.drive, float(trial.time[-1]) + 0.1, 0.005)
    return replace(trial, drive=(), joint_angle=readonly(command.angle_at(trial.time)))


def derivative_error(fish: Fish, trial: Trial, effect: Effect, values: dict[str, float], short: str) -> float:
    """Return how far the sensitivity is off a difference of whole predictions, relative to the largest.

    Samples next to the start and to steps of the drive are left out: a prediction has a kink in time there.
    """
    model = Model(fish, (effect,))
    name = f"{effect.name}.{short}"
    full = model.values({f"{effect.name}.{key}": value for key, value in values.items()})
    step = 2e-4 * effect.declaration(short).scale

    def at(value: float) -> FloatArray:
        return model.predict(trial, full | {name: value}).velocity

    exact = sensitivities(model, trial, full, [name])[:, :, 0]
    expected = sum(w * (at(full[name] + k * step) - at(full[name] - k * step)) for k, w in _EIGHTH) / step
    apart = np.all([np.abs(trial.time - segment.start) > 0.01 for segment in trial.drive], axis=0)
    return float(np.max(np.abs(exact - expected)[apart].max(axis=0) / np.abs(expected)[apart].max()))
