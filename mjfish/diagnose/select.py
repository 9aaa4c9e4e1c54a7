"""Which cause: the confidence set by test inversion, and the goodness of fit of its members.

A cause l stays in the set if, were l the truth, the best rival would beat it by the observed margin more often than in
5 % of cases: D_l = max_k LR_k - LR_l against its distribution in the linear model, u ~ N(I_l psi_l, I) with all
candidates' scores correlated as their signatures are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mjfish.diagnose.evidence import Evidence, gather
from mjfish.diagnose.refit import Refit
from mjfish.effects.effect import Effect

#: A cause is kept in the confidence set above this p value.
KEEP = 0.05
#: A cause that fits worse than this in either of two tests is no explanation: four true causes in a thousand are lost.
GOODNESS = 0.002


@dataclass(frozen=True)
class Standing:
    """How one refitted candidate stands against the others.

    Attributes:
        rival_p: p value of the margin by which the best rival beats it.
        saturated_p: of the joint score of all other candidates at its refit.
        omnibus_p: of the omnibus basis at its refit.
    """

    rival_p: float
    saturated_p: float
    omnibus_p: float

    @property
    def in_set(self) -> bool:
        """Whether the data cannot tell it from the best."""
        return self.rival_p >= KEEP

    @property
    def fits(self) -> bool:
        """Whether nothing systematic is left once it is in the model."""
        return min(self.saturated_p, self.omnibus_p) >= GOODNESS


def rival_p(evidence: Evidence, refits: Mapping[str, Refit], rng: np.random.Generator) -> dict[str, float]:
    """Return, per refitted candidate, the p value of the margin by which the best rival beats it."""
    adjusted = {name: one.gain - _extra(one) for name, one in refits.items()}
    best = max(adjusted.values())
    result = {}
    for name, gain in adjusted.items():
        mean = np.zeros(len(evidence.score))
        block = evidence.blocks[name]
        guess = _direction(evidence, name)
        strength = float(guess @ evidence.information[block, block] @ guess)
        if strength > 0.0 and gain > 0.0:
            mean = evidence.information[:, block] @ guess * np.sqrt(gain / strength)
        draws = evidence.statistics(evidence.null_draws(rng, mean))
        margin = np.max([draws[k] for k in refits], axis=0) - draws[name]
        result[name] = float((1 + np.count_nonzero(margin >= best - gain - 1e-9)) / (1 + len(margin)))
    return result


def standings(
    evidence: Evidence, refits: Mapping[str, Refit], candidates: Sequence[Effect], rng: np.random.Generator
) -> dict[str, Standing]:
    """Return the standing of every refitted candidate; the goodness of fit only of those in the confidence set."""
    rivals = rival_p(evidence, refits, rng)
    result = {}
    for name, one in refits.items():
        if rivals[name] < KEEP:
            result[name] = Standing(rivals[name], 0.0, 0.0)
            continue
        after = gather(one.problem, one.fit, candidates)
        result[name] = Standing(rivals[name], after.saturated_p(), after.omnibus_p())
    return result


def _extra(one: Refit) -> float:
    """Expected gain of the shape parameters alone, which the linear model does not have: one each."""
    return float(sum(p.shape for p in one.effect.parameters))


def _direction(evidence: Evidence, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the candidate's one-step amplitudes in units of their scale; one scale where they are all zero."""
    own = evidence.amplitudes_of(name)
    guess = evidence.first_guess(name)
    psi = np.array([(guess[p.name] - p.default) / p.scale for p in own])
    return psi if np.any(psi) else np.ones(len(own))


def chance(statistic: float, freedom: int) -> float:
    """Return the p value of a likelihood-ratio statistic."""
    return float(stats.chi2.sf(max(statistic, 0.0), freedom))
