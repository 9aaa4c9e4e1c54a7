"""How smooth a learned curve is: the sd of its prior by marginal likelihood, and its effective degrees of freedom.

Fellner and Schall's step ([Wood2017] sec. 6.6; [WoodFasiolo2017]) on the whitened linearisation with known noise: with
S = R'R of all priors and S_b of one of them, at the mode a,

    sd_b^2  <-  sd_b^2  a' S_b a / (tr(S^- S_b) - tr((J'J + S)^-1 S_b))

[Wood2017] S. Wood, Generalized Additive Models (2nd ed.), ch. 6.
[WoodFasiolo2017] S. Wood and M. Fasiolo, Biometrics 73.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.estimation.fit import Fit, fit_or_raise
from mjfish.estimation.problem import Problem

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
    means = {prior.name: prior.mean for prior in problem.priors}
    declared = {prior.name: prior.sd for effect in problem.model.effects for prior in effect.priors()}
    learned = [prior.name for prior in problem.priors if prior.learned]
    for _ in range(_STEPS if learned else 0):
        blocks = {name: rows[name].T @ rows[name] / sds[name] ** 2 for name in rows}
        total = np.sum(list(blocks.values()), axis=0)
        pull = np.sum([means[name] * rows[name].sum(axis=0) / sds[name] ** 2 for name in rows], axis=0)
        inverse = np.linalg.pinv(gram + total, hermitian=True)
        a = inverse @ (score + pull)
        pseudo = np.linalg.pinv(total, hermitian=True)
        changes = []
        for name in learned:
            block = blocks[name]
            spent = max(float(np.sum(pseudo * block) - np.sum(inverse * block)), 1e-6)
            change = float(np.clip(np.sqrt(max(float(a @ block @ a), 1e-12) / spent), 1.0 / _STEP, _STEP))
            sd = float(np.clip(sds[name] * change, _RANGE[0] * declared[name], _RANGE[1] * declared[name]))
            changes.append(abs(np.log(sd / sds[name])))
            sds[name] = sd
        if max(changes) < 0.01:
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
