"""Selection of a noise: as stated where the data do not contradict it, else the likeliest model.

Trials that were sampled at different steps have a noise model for each step. Models that count in samples
(autoregressive ones, filters of positions) mean another spectrum at another step, and what thinned or smoothed a record
to its step left other noise in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter, unit_impulse

from mjfish.data import Trial
from mjfish.noise.autoregressive import Autoregressive, Noise, floor
from mjfish.noise.kalman import Gains
from mjfish.noise.sample import NoiseSample, remaining_power
from mjfish.noise.spectral import (
    DifferentiationNoise,
    GaussMarkov,
    differentiation_noise,
    gauss_markov,
    longest,
    process_noise,
    sharpened,
)
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly


@dataclass(frozen=True, eq=False)
class NoiseByRate(Noise):
    """Noise by sampling step.

    Attributes:
        sigma: (3,) root mean square of those of the models.
        models: by step [s], two digits.
    """

    models: Mapping[float, Noise] = field(default_factory=dict)

    @staticmethod
    def of(models: Mapping[float, Noise]) -> NoiseByRate:
        """Return the noise of these models by step."""
        return NoiseByRate(
            readonly(np.sqrt(np.mean([model.sigma**2 for model in models.values()], axis=0))), models=dict(models)
        )

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of the model of the trial's step, or of the nearest step there is."""
        nearest = min(self.models, key=lambda known: abs(np.log(known / rounded_step(trial))))
        return self.models[nearest].filters(trial, seen)


def rounded_step(trial: Trial) -> float:
    """Return the step of a trial [s], two digits."""
    return float(f"{trial.step:.2g}")


def by_step(trials: Sequence[Trial]) -> dict[float, list[int]]:
    """Return, by step [s], which trials were sampled at it."""
    steps = [rounded_step(trial) for trial in trials]
    return {step: [index for index, own in enumerate(steps) if own == step] for step in steps}


#: A stated sigma is contradicted when the estimate is off by more than this many of its standard errors.
CONTRADICTED = 5.0
#: Log-likelihood by which process noise must beat the other models, which have fewer parameters.
_LIKELIER = 10.0
#: Log-likelihood by which noise that explains a pattern of the runs must beat the noise of the rest, for it to be none.
_PATTERN = 20.0

#: Gives the state Jacobians A (n, 3, 3) of the trials by name, see `mjfish.noise.spectral`; asked for only if needed.
Jacobians = Callable[[], Mapping[str, FloatArray]]


def select(
    left: NoiseSample, stated: FloatArray | None, jacobians: Jacobians, *, patterns: bool = True
) -> tuple[Noise, str]:
    """Return the noise model of residuals, and a sentence on it where it is not the stated one.

    Args:
        left: the residuals.
        stated: (3,) sigma that the dataset gives, or None.
        jacobians: of the trials, for process noise.
        patterns: whether to ask if a pattern of the runs is taken for noise.
    """
    what = "estimated from the data"
    if stated is not None:
        if np.all(np.abs(excess(left, stated)) < CONTRADICTED) and left.autoregressive().order == 0:
            return Noise.white(stated), ""
        what = "the stated noise does not fit the data; estimated instead"
    sigma, least = left.sigma, floor(left.trials)
    # of the noise itself: innovations of a blue one may be far smaller
    floored = Noise.white(np.maximum(sigma, least)) if stated is None and np.any(sigma < least) else None
    found = {
        step: _at_one_step(left.of_trials(index), floored, jacobians, patterns)
        for step, index in by_step(left.trials).items()
    }
    if len(found) == 1:
        ((noise, words),) = found.values()
        return noise, f"noise: {what} ({words})"
    listed = "; ".join(f"every {step:g} s: {words}" for step, (_, words) in found.items())
    models = NoiseByRate.of({step: noise for step, (noise, _) in found.items()})
    return models, f"noise: {what} by sampling step ({listed})"


def excess(left: NoiseSample, sigma: FloatArray) -> FloatArray:
    """Return by how many standard errors the spread of residuals is above sigma (3,)."""
    return np.asarray((left.sigma / sigma - 1.0) * np.sqrt(2.0 * left.free))


def _at_one_step(
    left: NoiseSample, floored: Autoregressive | None, jacobians: Jacobians, patterns: bool
) -> tuple[Noise, str]:
    """Return the noise as the residuals have it, or as they have it but for a pattern of the runs, and it in words.

    A pattern, levels by which runs differ or a shape that they share, is no noise where the rest contradicts it by far.
    White noise and that of differentiated positions are too small at low frequencies to explain a pattern.
    """
    plain = _likeliest(left, floored or left.autoregressive(), jacobians)
    too_small = isinstance(plain[0], DifferentiationNoise) or (
        isinstance(plain[0], Autoregressive) and plain[0].order == 0
    )
    if not patterns or len(left.residuals) < 2 or too_small:
        return plain
    explained, leads = left.log_likelihood(plain[0]), {plain: _PATTERN}
    for rest, pattern in ((left.without_levels, "runs differ in level"), (left.without_shapes, "runs share a shape")):
        remainder = rest()
        noise, words = _likeliest(remainder, remainder.autoregressive(), jacobians)
        leads[noise, f"{words}; {pattern} that it does not explain"] = explained - left.log_likelihood(noise)
    return max(leads, key=lambda found: leads[found])


def _likeliest(left: NoiseSample, found: Autoregressive, jacobians: Jacobians) -> tuple[Noise, str]:
    """Return the likeliest of autoregressive, Gauss-Markov, differentiation and process noise, and it in words."""
    if found.order == 0:
        return found, _described(found)
    rough, forces = differentiation_noise(left), process_noise(left, jacobians())
    models: tuple[Noise, ...] = (found, gauss_markov(left, remaining_power(left)), rough, forces)
    likelihood = {model: left.log_likelihood(model) for model in models}
    best = max(models[:-1], key=lambda model: likelihood[model])
    if likelihood[forces] > likelihood[best] + _LIKELIER:
        return forces, (
            f"random accelerations {_three(forces.push)} over {forces.time:g} s push the fish, sigma of the camera "
            f"{_three(forces.sigma)}; the innovations form of the fit is used"
        )
    if isinstance(best, DifferentiationNoise):
        best = sharpened(best, left)
        return best, f"of positions differentiated over {best.window} samples; sigma {_three(best.sigma)}"
    if isinstance(best, GaussMarkov):
        slow = "; these runs are too short to tell so slow a drift from an error of the model: record longer ones"
        return best, (
            f"a drift of {_three(best.drift)} over {_three(best.time)} s under white noise of {_three(best.sigma)}"
            + (slow if np.any(best.time > 0.99 * longest(left)) else "")
        )
    return found, _described(found)


def _three(values: FloatArray) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def _described(noise: Autoregressive) -> str:
    """Return the noise in words, with the standard deviation of the process itself, not of its innovations."""
    kind = "white" if noise.order == 0 else f"autoregressive of order {noise.order}"
    sigma = noise.sigma * [np.linalg.norm(lfilter([1.0], [1.0, *-phi], unit_impulse(4000))) for phi in noise.phi]
    return f"{kind}; sigma of surge, sway, yaw rate: {_three(sigma)}"
