"""Noise seen through the saturated model: what is left when the coefficients and every candidate are taken out.

Estimating the noise from the residual of the baseline would count the effect as noise; the saturated residual does not,
to first order (docs/notes/004). A stated sigma is believed as long as the data do not contradict it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.signal import lfilter, unit_impulse

from mjfish.arrays import FloatArray
from mjfish.diagnose import algebra
from mjfish.diagnose.noise.coloured import Coloured, grid
from mjfish.diagnose.noise.differentiated import Differentiated, differentiated
from mjfish.diagnose.noise.drifting import drifting, longest
from mjfish.diagnose.noise.forces import pushed
from mjfish.diagnose.noise.misread import Misread, misreading, unaccounted
from mjfish.diagnose.noise.spectrum import spectrum
from mjfish.diagnose.noise.stepwise import Model, Stepwise, parts
from mjfish.frames import CHANNELS
from mjfish.identify import Fit, Noise, Problem
from mjfish.identify.noise import estimate, floor

#: A stated sigma is contradicted when the estimate is off by more than this many of its standard errors.
_CONTRADICTED = 5.0
#: Log-likelihood by which forces behind the noise must beat plain coloured noise, which has more parameters.
_LIKELIER = 10.0
#: Log-likelihood by which noise with the levels of runs must beat noise without, for these to be none.
_LEVELS = 20.0
#: Draws of white noise that tell what the saturated model takes of a spectrum, and the least share that is left.
_DRAWS, _LEAST = 16, 0.02


@dataclass(frozen=True, eq=False)
class Saturated:
    """What the saturated model leaves, in physical units.

    Attributes:
        residuals: (n_r, 3) per trial.
        span: (n_r, 3, k) per trial, of what it explains; as columns over all trials divided by sigma, orthonormal.
        lost: degrees of freedom per channel that it took.
    """

    residuals: list[FloatArray]
    span: list[FloatArray]
    lost: float

    def of(self, trials: Sequence[int]) -> Saturated:
        """Return that of some trials, which take their share of the freedom."""
        count, total = (sum(len(self.residuals[i]) for i in which) for which in (trials, range(len(self.residuals))))
        residuals, span = ([block[i] for i in trials] for block in (self.residuals, self.span))
        return Saturated(residuals, span, self.lost * count / total)


def saturated(problem: Problem, fit: Fit, known: Sequence[FloatArray]) -> Saturated:
    """Return residuals without anything that the saturated model explains; it weighs channels by sigma alone."""
    white = replace(problem, noise=Noise.white(problem.noise.sigma))
    jacobian = white.whiten(white.sensitivities(fit.x))[:, ~fit.at_bound]
    return _left(problem, problem.raw(fit.x), np.concatenate([jacobian, white.whiten(known)], axis=1))


def within_runs(problem: Problem, left: Saturated) -> Saturated:
    """Return what is left when every channel of every run has a level of its own, besides."""
    levels = linalg.block_diag(*[np.tile(np.eye(3), (len(block), 1)) for block in left.residuals])
    return _left(problem, left.residuals, np.concatenate([_columns(problem, left), levels], axis=1))


def _left(problem: Problem, residuals: Sequence[FloatArray], columns: FloatArray) -> Saturated:
    """Take columns (3 n, k), divided by sigma, out of residuals (n_r, 3) of the trials."""
    sigma, ends = problem.noise.sigma, np.cumsum([len(block) for block in residuals])[:-1]
    span = algebra.orthonormal(columns)
    scaled = np.concatenate([(block / sigma).ravel() for block in residuals])
    left = algebra.project_out(span, scaled[:, None])[:, 0].reshape(-1, 3) * sigma
    explained = span.reshape(len(left), 3, -1) * sigma[:, None]
    return Saturated(np.split(left, ends), np.split(explained, ends), span.shape[1] / 3.0)


def _columns(problem: Problem, left: Saturated) -> FloatArray:
    """Return the columns (3 n, k) that were taken out, divided by sigma."""
    scaled = [block / problem.noise.sigma[:, None] for block in left.span]
    return np.concatenate([block.reshape(3 * len(block), -1) for block in scaled])


def noise_of(problem: Problem, fit: Fit, known: Sequence[FloatArray], stated: FloatArray | None) -> tuple[Noise, str]:
    """Return the noise model that the tests use, and a sentence on it where it is not the stated one.

    Args:
        problem: that was fitted.
        fit: its result.
        known: `mjfish.diagnose.evidence.signatures` of every effect that may explain something and is not in the model.
        stated: (3,) sigma that the dataset gives, or None.
    """
    left = saturated(problem, fit, known)
    through = misreading(problem, fit)
    if through is None:
        return _of_velocities(problem, fit, left, stated)
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
    base, told = _of_velocities(problem, fit, left, stated)
    allowed = "errors of the measured joint angles are allowed for"
    return Misread.of(base, through), f"{told}; {allowed}" if told else f"noise: {allowed}"


def _excess(left: Saturated, sigma: FloatArray) -> FloatArray:
    """Return by how many standard errors the spread of residuals is above sigma (3,)."""
    free = sum(len(block) for block in left.residuals) - left.lost
    spread = np.sqrt(sum((block**2).sum(axis=0) for block in left.residuals) / free)
    return np.asarray((spread / sigma - 1.0) * np.sqrt(2.0 * free))


def _of_velocities(
    problem: Problem, fit: Fit, left: Saturated, stated: FloatArray | None
) -> tuple[Model | Stepwise, str]:
    """Return the noise of the velocities alone from saturated residuals, and a sentence on it."""
    what = "estimated from the data"
    if stated is not None:
        if np.all(np.abs(_excess(left, stated)) < _CONTRADICTED) and _estimated(problem, left).order == 0:
            return Coloured.of(Noise.white(stated)), ""
        what = "the stated noise does not fit the data; estimated instead"
    total = sum(len(block) for block in left.residuals)
    spread = np.sqrt(sum((block**2).sum(axis=0) for block in left.residuals) / (total - left.lost))
    least = floor(problem.trials)
    models, told = {}, []
    for step, (here, part) in parts(problem).items():
        # of the noise itself: innovations of a blue one may be far smaller
        given = Noise.white(np.maximum(spread, least)) if stated is None and np.any(spread < least) else None
        models[step], words = _with_or_without_levels(part, fit, left.of(here), given)
        told.append((step, words))
    if len(models) == 1:
        return models[told[0][0]], f"noise: {what} ({told[0][1]})"
    listed = "; ".join(f"every {step:g} s: {words}" for step, words in told)
    return Stepwise.of(models), f"noise: {what} by sampling step ({listed})"


def _with_or_without_levels(problem: Problem, fit: Fit, left: Saturated, given: Noise | None) -> tuple[Model, str]:
    """Return the noise as the residuals have it, or as they have it within runs, and it in words.

    Where runs differ in level by far more than what they do within themselves would have them differ, the levels are no
    noise. White noise and that of differentiated positions are too small at low frequencies to take them for theirs.
    """
    both = _better(problem, fit, left, given or _estimated(problem, left))
    if isinstance(both[0], Differentiated) or _is_white(both[0]):
        return both
    inner = within_runs(problem, left)
    within = _better(problem, fit, inner, given or _estimated(problem, inner))
    if likelihood(both[0], problem, left) - likelihood(within[0], problem, left) <= _LEVELS:
        return both
    return within[0], f"{within[1]}; runs differ in level by more than that"


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
        return rough, f"of positions differentiated over {rough.window} samples; sigma {_three(rough.sigma)}"
    if worth[drift] > worth[coloured]:
        under = f"under white noise of {_three(drift.sigma)}"
        told = f"a wander of {_three(drift.wander)} over {_three(drift.time)} s {under}"
        if np.any(drift.time > 0.99 * longest(problem)):
            told += "; it is as slow as these runs can tell, and an error of the model may look so: record longer ones"
        return drift, told
    return coloured, _described(found)


def kept(problem: Problem, left: Saturated) -> FloatArray:
    """Return which share (bands, 3) of the power of white noise the saturated model leaves, band by band.

    It explains what is slow better than what is fast; a drift would be taken for smaller than it is. By draws.
    """
    rng = np.random.default_rng(0)
    basis = algebra.orthonormal(_columns(problem, left))
    ends = np.cumsum([len(block) for block in left.residuals])[:-1]
    power = np.zeros(2)
    for _ in range(_DRAWS):
        white = rng.standard_normal(len(basis))
        both = (white, white - basis @ (basis.T @ white))
        power = power + np.stack(
            [np.einsum("bcc->bc", spectrum(problem, np.split(one.reshape(-1, 3), ends)).power).real for one in both],
            axis=-1,
        )
    return np.asarray(np.clip(power[..., 1] / power[..., 0], _LEAST, 1.0))


def likelihood(noise: Model, problem: Problem, left: Saturated) -> float:
    """Return the restricted log-likelihood of what the saturated model leaves, less a constant.

    -1/2 (r' V^-1 r - r' V^-1 X (X' V^-1 X)^-1 X' V^-1 r + log det V + log det X' V^-1 X)  [Patterson1971]

    with the covariance V of the noise and the columns X of the saturated model: what these explain of a slow noise is
    no evidence against it.

    [Patterson1971] H. Patterson and R. Thompson, Biometrika 58.
    """
    white, columns, total = [], [], 0.0
    for i, (trial, block, span) in enumerate(zip(problem.trials, left.residuals, left.span, strict=True)):
        mask = problem.mask(i)
        both = noise.of_trial(trial, mask, np.concatenate([block[:, :, None], span], axis=2), (0,))
        white.append(both[:, :, 0].ravel())
        columns.append(both[:, :, 1:].reshape(len(white[-1]), -1))
        total -= 0.5 * noise.log_determinant(trial, grid(trial.time, mask))
    z, x = np.concatenate(white), np.concatenate(columns)
    there = np.linalg.norm(x, axis=0) > 0.0
    q, r = np.linalg.qr(x[:, there])
    z = z - q @ (q.T @ z)
    return float(total - 0.5 * (z @ z) - np.sum(np.log(np.abs(np.diag(r)))))


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
