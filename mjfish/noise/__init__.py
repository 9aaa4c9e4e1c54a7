"""Noise of measured velocities: one model a class, each whitens, has a likelihood and an estimator.

| model | class | estimator |
|---|---|---|
| white, autoregressive | `Autoregressive` | `estimate` (Yule-Walker, order by BIC) |
| Gauss-Markov (Ornstein-Uhlenbeck) under white noise | `GaussMarkov` | `gauss_markov` (Whittle) |
| differentiated positions | `DifferentiationNoise` | `differentiation_noise` (Whittle) |
| random forces on the fish, white camera noise | `ProcessNoise` | `process_noise` (Whittle) |
| another model for each sampling step | `NoiseByRate` | `select` |
| errors of measured joint angles on top of another noise | `ErrorsInVariables` | its `cleared` |

All are `Noise`: ``whiten(trial, mask, block)`` for residuals and Jacobians alike, ``log_determinant(trial, mask)``,
``to_dict()``. Estimators take a `NoiseSample`, residuals with what was taken out of them; its
``log_likelihood(noise)`` compares models, and `select` chooses one.
"""

from mjfish.noise.autoregressive import Autoregressive, Noise, estimate
from mjfish.noise.errors_in_variables import ErrorsInVariables
from mjfish.noise.sample import NoiseSample
from mjfish.noise.selection import NoiseByRate, select
from mjfish.noise.spectral import (
    DifferentiationNoise,
    GaussMarkov,
    ProcessNoise,
    differentiation_noise,
    gauss_markov,
    process_noise,
)

__all__ = [
    "Autoregressive",
    "DifferentiationNoise",
    "ErrorsInVariables",
    "GaussMarkov",
    "Noise",
    "NoiseByRate",
    "NoiseSample",
    "ProcessNoise",
    "differentiation_noise",
    "estimate",
    "gauss_markov",
    "process_noise",
    "select",
]
