"""Sizes by marginal likelihood: how smooth a learned curve is, and how far the clock of the drive wanders.

**Smoothness.** Fellner and Schall's step ([Wood2017] sec. 6.6; [WoodFasiolo2017]) for the sd of a prior, on the
whitened linearisation with known noise: with S = R'R of all priors and S_b of one of them, at the mode a,

    sd_b^2  <-  sd_b^2  a' S_b a / (tr(S^- S_b) - tr((J'J + S)^-1 S_b))

**Walk of the clock.** A walk of time w(t) whose modes are parameters of every run. Whether there is one is asked of the
residual that coefficients and candidates leave, by restricted likelihood. If so, its modes are fitted,
a_m ~ N(0, size^2), and the same step with the covariance C of the modes is

    size^2  <-  sum_m a_m^2 / sum_m (1 - C_mm / size^2)

[Wood2017] S. Wood, Generalized Additive Models (2nd ed.), ch. 6.
[WoodFasiolo2017] S. Wood and M. Fasiolo, Biometrics 73.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.estimation.clocks import WALK
from mjfish.estimation.fit import Fit, fit_or_raise
from mjfish.estimation.problem import Problem
from mjfish.noise import ErrorsInVariables, Noise, NoiseSample

#: Largest change of an sd in one step, smallest and largest sd relative to the declared one, and steps.
_STEP, _RANGE, _STEPS = 4.0, (1e-3, 10.0), 30
#: Singular values below this share of the largest are rounding.
_RANK = 1e-12
#: A relative change of every sd below this one ends a search; how often the model is linearised anew.
_SAME, _ROUNDS = 0.3, 3
#: Most evaluations of a fit with new sds, and its tolerance: it starts from the fit with the old ones.
_MOST, _TOLERANCE = 40, 1e-4


def smoothed(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """Return problem and fit with the sds of learned priors found by marginal likelihood.

    Args:
        problem: that was fitted.
        found: its result.
    """
    for _ in range(_ROUNDS):
        sds = learned_sds(problem, found)
        before = {prior.name: prior.sd for prior in problem.priors}
        if all(abs(np.log(sd / before[name])) < _SAME for name, sd in sds.items()):
            break
        problem = replace(problem, prior_sds={**problem.prior_sds, **sds})
        found = fit_or_raise(problem, found.x, tolerance=_TOLERANCE, evaluations=_MOST)
    return problem, found


def learned_sds(problem: Problem, found: Fit) -> dict[str, float]:
    """Return the sds of the learned priors, by name, that maximise the marginal likelihood of the linearised model."""
    free = np.flatnonzero(~found.at_bound)
    jacobian = found.jacobian.chosen(~found.at_bound)
    gram = jacobian.gram()
    score = jacobian.transposed_times(found.residual + jacobian @ found.x[free])
    rows = {prior.name: problem.prior_rows(prior)[:, free] * prior.sd for prior in problem.priors}
    sds = {prior.name: prior.sd for prior in problem.priors}
    declared = {prior.name: prior.sd for effect in problem.model.effects for prior in effect.priors()}
    learned = [prior.name for prior in problem.priors if prior.learned]
    for _ in range(_STEPS if learned else 0):
        before = dict(sds)
        blocks = {name: rows[name].T @ rows[name] / sds[name] ** 2 for name in rows}
        total = np.sum(list(blocks.values()), axis=0)
        pull = np.sum([p.mean * rows[p.name].sum(axis=0) / sds[p.name] ** 2 for p in problem.priors], axis=0)
        inverse, pseudo = (np.linalg.pinv(matrix, hermitian=True) for matrix in (gram + total, total))
        a = inverse @ (score + pull)
        for name in learned:
            spent = max(float(np.sum(pseudo * blocks[name]) - np.sum(inverse * blocks[name])), 1e-6)
            change = np.clip(np.sqrt(max(float(a @ blocks[name] @ a), 1e-12) / spent), 1.0 / _STEP, _STEP)
            low, high = (share * declared[name] for share in _RANGE)
            sds[name] = float(np.clip(sds[name] * float(change), low, high))
        if max(abs(np.log(sds[name] / before[name])) for name in learned) < 0.01:
            break
    return {name: sds[name] for name in learned}


def effective_degrees_of_freedom(problem: Problem, found: Fit, names: Sequence[str]) -> float:
    """Return tr((J'J + S)^-1 J'J) over the parameters of these names: how many of them the data determine.

    It is their number less tr((J'J + S)^-1 R'R) of their priors R, which is |R V / s|^2 with [J; R] = U s V'.
    """
    free = np.flatnonzero(~found.at_bound)
    stacked = found.jacobian.above(problem.prior_root).chosen(~found.at_bound).factors.triangle.dense()
    lengths = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    _, singular, right = np.linalg.svd(stacked / lengths, full_matrices=False)
    kept = singular > _RANK * singular.max(initial=0.0)
    own = np.array([found.parameters[i].name in names for i in free])
    known = np.any(problem.prior_root[:, free[own]], axis=1)
    prior = problem.prior_root[known][:, free] / lengths
    taken = float(np.sum((prior @ right[kept].T / singular[kept]) ** 2))
    return max(float(np.count_nonzero(own)) - int(np.count_nonzero(~kept)) - taken, 0.0)


#: Sizes of a walk that are tried [s^0.5].
_TRIED = (1e-3, 4e-3, 1.6e-2, 6.4e-2)
#: Log-likelihood that a walk must gain: a p value of 8e-6 for one number more.
CLEAR = 10.0
#: Share of the size that is left without any one run. The least of 2000 draws of five runs with ten modes is 0.73.
_SHARE = 0.5
#: Rounds of the size of a walk, a relative change of it that ends them, and a size [s^0.5] that is none.
_WALK_ROUNDS, _SAME_SIZE, _NOTHING = 6, 0.03, 1e-5


def first_size(problem: Problem, found: Fit, left: NoiseSample, plain: Noise) -> float:
    """Return the likeliest of a few sizes of a walk [s^0.5]; 0 where none is clearly likelier than no walk.

    The velocities are linear in the modes. An offset of the clock and a wrong frequency, which are no walk, are taken
    out of every run before.

    Args:
        problem, found: without a walk, and its fit.
        left: residuals without anything that the saturated model explains.
        plain: noise of them without a walk.
    """
    wide = replace(problem, walk=1.0, free_clock=True)
    names = [p.name for p in wide.parameters if f":{WALK}." in p.name or p.name.endswith(":clock.offset")]
    slopes = wide.slopes(wide.start(found.values), names).velocity  # by the offset, then by the modes
    levels = [
        [block[:, :, :1], trial.time[mask][:, None, None] * block[:, :, :1]]
        for block, trial, mask in zip(slopes, left.trials, left.masks, strict=True)
    ]
    left = left.without_trial_columns([np.concatenate(pair, axis=2) for pair in levels])
    modes = {
        trial.name: np.zeros((len(trial.time), *block.shape[1:]))
        for trial, block in zip(left.trials, slopes, strict=True)
    }
    for trial, mask, block in zip(left.trials, left.masks, slopes, strict=True):
        modes[trial.name][mask] = block

    def likelihood(size: float) -> float:
        return left.log_likelihood(ErrorsInVariables.of(plain, lambda trial: size * modes[trial.name][:, :, 1:]))

    most, size = max((likelihood(size), size) for size in _TRIED)
    return size if most - left.log_likelihood(plain) >= CLEAR else 0.0


def with_size(problem: Problem, found: Fit, size: float) -> tuple[Problem, Fit]:
    """Return problem and fit with a walk of the likeliest size; without one where its size goes to nothing.

    Args:
        problem: without a walk.
        found: its fit.
        size: to begin with [s^0.5].
    """
    for _ in range(_WALK_ROUNDS):
        walking = replace(problem, walk=size)
        found = fit_or_raise(walking, walking.start(found.values), tolerance=1e-4)
        before, size = size, walk_size(walking, found)[0]
        if size < _NOTHING:
            return problem, fit_or_raise(problem, problem.start(found.values), tolerance=1e-4)
        if abs(size / before - 1.0) < _SAME_SIZE:
            break
    return walking, found


def walk_size(problem: Problem, found: Fit, without: str = "") -> tuple[float, float]:
    """Return the next size of the walk [s^0.5], and how many modes the data determine.

    Args:
        problem, found: with a walk, and its fit.
        without: name of a run that does not take part.
    """
    parts = [p.name.partition(f":{WALK}.") for p in found.parameters]
    own = [i for i, (run, mode, _) in enumerate(parts) if mode and run != without]
    determined = float(np.sum(1.0 - np.diag(found.covariance)[own] / problem.walk**2))
    return float(np.sqrt(np.sum(found.x[own] ** 2) / max(determined, 1e-9))), determined


def of_every_run(problem: Problem, found: Fit) -> bool:
    """Return whether a walk is seen without any one run, too: frames that one run lost are no walk of the drive."""
    others = [walk_size(problem, found, trial.name)[0] for trial in problem.trials if len(problem.trials) > 1]
    return min(others, default=problem.walk) > _SHARE * problem.walk


def log_likelihood_gained(problem: Problem, found: Fit) -> float:
    """Return the marginal log-likelihood that a walk gains, its modes integrated out about their likeliest values.

        1/2 (SSE_0 - SSE) + 1/2 log det (C / size^2)

    with SSE of the fit, the prior of the modes in it, and SSE_0 without a walk.
    """
    own = [i for i, p in enumerate(found.parameters) if f":{WALK}." in p.name]
    _, log_determinant = np.linalg.slogdet(found.covariance[np.ix_(own, own)] / problem.walk**2)
    still = replace(problem, walk=0.0)
    return 0.5 * (
        fit_or_raise(still, still.start(found.values), tolerance=1e-4).sse - found.sse + float(log_determinant)
    )
