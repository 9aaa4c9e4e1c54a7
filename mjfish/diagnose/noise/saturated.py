"""Noise seen through the saturated model: what is left when the coefficients and every candidate are taken out.

Estimating the noise from the residual of the baseline would count the effect as noise; the saturated residual does not,
to first order (docs/notes/004). A stated sigma is believed as long as the data do not contradict it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnose import algebra
from mjfish.diagnose.noise.coloured import Coloured, grid
from mjfish.diagnose.noise.differentiated import differentiated
from mjfish.diagnose.noise.drifting import drifting
from mjfish.diagnose.noise.forces import pushed
from mjfish.diagnose.noise.misread import Misread, misreading, unaccounted
from mjfish.diagnose.noise.stepwise import Model, Stepwise, parts
from mjfish.frames import CHANNELS
from mjfish.identify import Fit, Noise, Problem
from mjfish.identify.noise import estimate, floor

#: A stated sigma is contradicted when the estimate is off by more than this many of its standard errors.
_CONTRADICTED = 5.0
#: Log-likelihood by which forces behind the noise must beat plain coloured noise, which has more parameters.
_LIKELIER = 10.0


def saturated_residuals(problem: Problem, fit: Fit, known: Sequence[FloatArray]) -> tuple[list[FloatArray], float]:
    """Return residuals (n_r, 3) per trial without anything that the saturated model explains, and the freedom it took.

    The regression weighs channels by sigma alone; the residuals are in physical units.
    """
    white = replace(problem, noise=Noise.white(problem.noise.sigma))
    jacobian = white.whiten(white.sensitivities(fit.x))[:, ~fit.at_bound]
    span = algebra.orthonormal(np.concatenate([jacobian, white.whiten(known)], axis=1))
    residual = np.concatenate([(one / problem.noise.sigma).ravel() for one in problem.raw(fit.x)])
    left = algebra.project_out(span, residual[:, None])[:, 0].reshape(-1, 3) * problem.noise.sigma
    sizes = [int(np.count_nonzero(problem.mask(i))) for i in range(len(problem.trials))]
    return np.split(left, np.cumsum(sizes)[:-1]), span.shape[1] / 3.0


def noise_of(problem: Problem, fit: Fit, known: Sequence[FloatArray], stated: FloatArray | None) -> tuple[Noise, str]:
    """Return the noise model that the tests use, and a sentence on it where it is not the stated one.

    Args:
        problem: that was fitted.
        fit: its result.
        known: `mjfish.diagnose.evidence.signatures` of every effect that may explain something and is not in the model.
        stated: (3,) sigma that the dataset gives, or None.
    """
    residuals, lost = saturated_residuals(problem, fit, known)
    through = misreading(problem, fit)
    if through is None:
        return _of_velocities(problem, fit, residuals, lost, stated)
    first = Misread.of(Coloured.of(Noise.white(problem.noise.sigma)), through)
    if (rest := unaccounted(problem.trials)) is not None:
        first, stated = Misread.of(Coloured.of(Noise.white(rest)), through), None
    cleared = [
        first.cleared(trial, problem.mask(i), block, problem.stretches(i))
        for i, (trial, block) in enumerate(zip(problem.trials, residuals, strict=True))
    ]
    blocks, lost = [block for block, _ in cleared], lost + sum(freedom for _, freedom in cleared) / len(CHANNELS)
    if rest is not None and np.all(_excess(blocks, lost, rest) < _CONTRADICTED):
        return first, ""
    base, told = _of_velocities(problem, fit, blocks, lost, stated)
    allowed = "errors of the measured joint angles are allowed for"
    return Misread.of(base, through), f"{told}; {allowed}" if told else f"noise: {allowed}"


def _excess(residuals: Sequence[FloatArray], lost: float, sigma: FloatArray) -> FloatArray:
    """Return by how many standard errors the spread of residuals (n_r, 3) is above sigma (3,)."""
    free = sum(len(block) for block in residuals) - lost
    spread = np.sqrt(sum((block**2).sum(axis=0) for block in residuals) / free)
    return np.asarray((spread / sigma - 1.0) * np.sqrt(2.0 * free))


def _of_velocities(
    problem: Problem, fit: Fit, residuals: Sequence[FloatArray], lost: float, stated: FloatArray | None
) -> tuple[Model | Stepwise, str]:
    """Return the noise of the velocities alone from saturated residuals (n_r, 3), and a sentence on it."""
    total = sum(len(block) for block in residuals)
    spread = np.sqrt(sum((block**2).sum(axis=0) for block in residuals) / (total - lost))
    what = "estimated from the data"
    if stated is not None:
        if (
            np.all(np.abs(_excess(residuals, lost, stated)) < _CONTRADICTED)
            and _estimated(problem, residuals, lost).order == 0
        ):
            return Coloured.of(Noise.white(stated)), ""
        what = "the stated noise does not fit the data; estimated instead"
    models, told = {}, []
    for step, (here, part) in parts(problem).items():
        own = [residuals[i] for i in here]
        count = sum(len(block) for block in own)
        found = _estimated(part, own, lost * count / total)
        least = floor(problem.trials)
        if stated is None and np.any(
            spread < least
        ):  # of the noise itself: innovations of a blue one may be far smaller
            found = Noise.white(np.maximum(spread, least))
        models[step], words = _better(part, fit, own, found)
        told.append((step, words))
    if len(models) == 1:
        return models[told[0][0]], f"noise: {what} ({told[0][1]})"
    listed = "; ".join(f"every {step:g} s: {words}" for step, words in told)
    return Stepwise.of(models), f"noise: {what} by sampling step ({listed})"


def _estimated(problem: Problem, residuals: Sequence[FloatArray], lost: float) -> Noise:
    return estimate(residuals, lost, [grid(trial.time, problem.mask(i)) for i, trial in enumerate(problem.trials)])


def _better(problem: Problem, fit: Fit, residuals: Sequence[FloatArray], found: Noise) -> tuple[Model, str]:
    """Return the likeliest of coloured, drifting and differentiated noise and noise through forces, and it in words."""
    coloured = Coloured.of(found)
    if found.order == 0:
        return coloured, _described(found)
    drift, rough = drifting(problem, residuals), differentiated(problem, residuals)
    forces = pushed(problem, fit, residuals)
    worth = {one: likelihood(one, problem, residuals) for one in (coloured, drift, rough, forces)}
    if worth[forces] > max(worth[coloured], worth[drift], worth[rough]) + _LIKELIER:
        told = f"random accelerations {_three(forces.push)} over {forces.time:g} s push the fish"
        return forces, f"{told}, sigma of the camera {_three(forces.sigma)}; the innovations form of the fit is used"
    if worth[rough] > max(worth[coloured], worth[drift]):
        return rough, f"of positions differentiated over {rough.window} samples; sigma {_three(rough.sigma)}"
    if worth[drift] > worth[coloured]:
        under = f"under white noise of {_three(drift.sigma)}"
        return drift, f"a wander of {_three(drift.wander)} over {_three(drift.time)} s {under}"
    return coloured, _described(found)


def likelihood(noise: Model, problem: Problem, residuals: Sequence[FloatArray]) -> float:
    """Return the log-likelihood of residuals (n_r, 3), less a constant: -1/2 (sum of white squares + log det)."""
    total = 0.0
    for i, (trial, block) in enumerate(zip(problem.trials, residuals, strict=True)):
        mask = problem.mask(i)
        white = noise.of_trial(trial, mask, block, (0,))
        seen = grid(trial.time, mask)
        total -= 0.5 * (float(np.sum(white**2)) + noise.log_determinant(trial, seen))
    return total


def _three(values: FloatArray) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def _described(noise: Noise) -> str:
    kind = "white" if noise.order == 0 else f"autoregressive of order {noise.order}"
    gain = [float(np.sqrt(_variance_gain(phi))) for phi in noise.phi]
    sigma = ", ".join(f"{s * g:.3g}" for s, g in zip(noise.sigma, gain, strict=True))
    return f"{kind}; sigma of surge, sway, yaw rate: {sigma}"


def _variance_gain(phi: FloatArray) -> float:
    """Return the variance of an autoregressive process whose innovations have variance 1."""
    response = np.zeros(4000)
    past = np.zeros(len(phi))
    for k in range(len(response)):
        response[k] = 1.0 if k == 0 else float(phi @ past)
        past = np.concatenate([[response[k]], past[:-1]]) if len(phi) else past
    return float(response @ response)
