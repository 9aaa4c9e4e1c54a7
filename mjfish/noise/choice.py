"""Which noise the tests use: as stated where the data do not contradict it, else the likeliest of five kinds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter, unit_impulse

from mjfish.arrays import FloatArray
from mjfish.estimation import Fit, Noise, Problem
from mjfish.estimation.noise import estimate, floor
from mjfish.frames import CHANNELS
from mjfish.noise.coloured import Coloured, grid
from mjfish.noise.differentiated import Differentiated, differentiated, sharpened
from mjfish.noise.drifting import drifting, longest
from mjfish.noise.forces import pushed
from mjfish.noise.misread import Misread, misreading, unaccounted
from mjfish.noise.saturated import Saturated, kept, levels, likelihood, saturated, shapes, without
from mjfish.noise.stepwise import Model, Stepwise, parts

#: A stated sigma is contradicted when the estimate is off by more than this many of its standard errors.
_CONTRADICTED = 5.0
#: Log-likelihood by which forces behind the noise must beat plain coloured noise, which has more parameters.
_LIKELIER = 10.0
#: Log-likelihood by which noise that explains a pattern of the runs must beat the noise of the rest, for it to be none.
_PATTERN = 20.0


def noise_of(
    problem: Problem, fit: Fit, known: Sequence[FloatArray], stated: FloatArray | None, *, patterns: bool = True
) -> tuple[Noise, str]:
    """Return the noise model that the tests use, and a sentence on it where it is not the stated one.

    Args:
        problem: that was fitted.
        fit: its result.
        known: `mjfish.diagnosis.evidence.signatures` of every effect that is not in the model.
        stated: (3,) sigma that the dataset gives, or None.
        patterns: whether to ask if a pattern of the runs is taken for noise.
    """
    left = saturated(problem, fit, known)
    through = misreading(problem, fit)
    if through is None:
        return _of_velocities(problem, fit, left, stated, patterns)
    first = Misread.of(Coloured.of(Noise.white(problem.noise.sigma)), through)
    if (rest := unaccounted(problem.trials)) is not None:
        first, stated = Misread.of(Coloured.of(Noise.white(rest)), through), None
    cleared = [
        first.cleared(trial, problem.mask(i), block, problem.stretches(i))
        for i, (trial, block) in enumerate(zip(problem.trials, left.residuals, strict=True))
    ]
    lost = left.lost + sum(freedom for _, freedom in cleared) / len(CHANNELS)
    left = Saturated([block for block, _ in cleared], left.span, lost)
    if rest is not None and np.all(_excess(left, rest) < _CONTRADICTED):
        return first, ""
    base, told = _of_velocities(problem, fit, left, stated, patterns)
    allowed = "errors of the measured joint angles are allowed for"
    return Misread.of(base, through), f"{told}; {allowed}" if told else f"noise: {allowed}"


def _excess(left: Saturated, sigma: FloatArray) -> FloatArray:
    """Return by how many standard errors the spread of residuals is above sigma (3,)."""
    return np.asarray((left.sigma / sigma - 1.0) * np.sqrt(2.0 * left.free))


def _of_velocities(
    problem: Problem, fit: Fit, left: Saturated, stated: FloatArray | None, patterns: bool
) -> tuple[Model | Stepwise, str]:
    """Return the noise of the velocities alone from saturated residuals, and a sentence on it."""
    what = "estimated from the data"
    if stated is not None:
        if np.all(np.abs(_excess(left, stated)) < _CONTRADICTED) and _estimated(problem, left).order == 0:
            return Coloured.of(Noise.white(stated)), ""
        what = "the stated noise does not fit the data; estimated instead"
    spread, least = left.sigma, floor(problem.trials)
    models, told = {}, []
    for step, (here, part) in parts(problem).items():
        # of the noise itself: innovations of a blue one may be far smaller
        given = Noise.white(np.maximum(spread, least)) if stated is None and np.any(spread < least) else None
        models[step], words = _of_one_step(part, fit, left.of(here), given, patterns)
        told.append((step, words))
    if len(models) == 1:
        return models[told[0][0]], f"noise: {what} ({told[0][1]})"
    listed = "; ".join(f"every {step:g} s: {words}" for step, words in told)
    return Stepwise.of(models), f"noise: {what} by sampling step ({listed})"


def _of_one_step(problem: Problem, fit: Fit, left: Saturated, given: Noise | None, patterns: bool) -> tuple[Model, str]:
    """Return the noise as the residuals have it, or as they have it but for a pattern of the runs, and it in words.

    A pattern, levels by which runs differ or a shape that they share, is no noise where the rest contradicts it by far.
    White noise and that of differentiated positions are too small at low frequencies to take it for theirs.
    """
    plain = _better(problem, fit, left, given or _estimated(problem, left))
    if not patterns or len(left.residuals) < 2 or isinstance(plain[0], Differentiated) or _is_white(plain[0]):
        return plain
    chosen, most, explained = plain, _PATTERN, likelihood(plain[0], problem, left)
    for pattern, words in ((levels, "runs differ in level"), (shapes, "runs share a shape")):
        rest = without(problem, left, pattern(problem))
        noise, told = _better(problem, fit, rest, _estimated(problem, rest))
        lead = explained - likelihood(noise, problem, left)
        if lead > most:
            chosen, most = (noise, f"{told}; {words} that it does not explain"), lead
    return chosen


def _is_white(noise: Model) -> bool:
    return isinstance(noise, Coloured) and noise.order == 0


def _estimated(problem: Problem, left: Saturated) -> Noise:
    seen = [grid(trial.time, problem.mask(i)) for i, trial in enumerate(problem.trials)]
    return estimate(left.residuals, left.lost, seen)


def _better(problem: Problem, fit: Fit, left: Saturated, found: Noise) -> tuple[Model, str]:
    """Return the likeliest of coloured, drifting and differentiated noise and noise through forces, and it in words."""
    coloured = Coloured.of(found)
    if found.order == 0:
        return coloured, _described(found)
    drift = drifting(problem, left.residuals, kept(problem, left))
    rough, forces = differentiated(problem, left.residuals), pushed(problem, fit, left.residuals)
    worth = {one: likelihood(one, problem, left) for one in (coloured, drift, rough, forces)}
    if worth[forces] > max(worth[coloured], worth[drift], worth[rough]) + _LIKELIER:
        told = f"random accelerations {_three(forces.push)} over {forces.time:g} s push the fish"
        return forces, f"{told}, sigma of the camera {_three(forces.sigma)}; the innovations form of the fit is used"
    if worth[rough] > max(worth[coloured], worth[drift]):
        rough = sharpened(rough, problem, left)
        return rough, f"of positions differentiated over {rough.window} samples; sigma {_three(rough.sigma)}"
    if worth[drift] > worth[coloured]:
        under = f"under white noise of {_three(drift.sigma)}"
        told = f"a wander of {_three(drift.wander)} over {_three(drift.time)} s {under}"
        if np.any(drift.time > 0.99 * longest(problem)):
            told += "; it is as slow as these runs can tell, and an error of the model may look so: record longer ones"
        return drift, told
    return coloured, _described(found)


def _three(values: FloatArray) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def _described(noise: Noise) -> str:
    kind = "white" if noise.order == 0 else f"autoregressive of order {noise.order}"
    gain = [float(np.sqrt(_variance_gain(phi))) for phi in noise.phi]
    sigma = ", ".join(f"{s * g:.3g}" for s, g in zip(noise.sigma, gain, strict=True))
    return f"{kind}; sigma of surge, sway, yaw rate: {sigma}"


def _variance_gain(phi: FloatArray) -> float:
    """Return the variance of an autoregressive process whose innovations have variance 1."""
    response = lfilter([1.0], [1.0, *-phi], unit_impulse(4000))
    return float(response @ response)
