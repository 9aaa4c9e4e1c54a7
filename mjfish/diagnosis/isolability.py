"""Isolability: from which size on a mechanism is told from another one, on these runs.

The typical direction of a mechanism is an amplitude: of its first formula in the catalogue that the runs show at all,
the one that they show best in units of its scale. With its signature s_k, the signatures L of all amplitudes of
mechanism l, the precision S_l of their prior and the projector M off the coefficients, a unit of k leaves beside l

    I_kl = s_k' M s_k - s_k' M L (L' M L + S_l)^+ L' M s_k,

and k is told from l with 90 % power from sqrt(18 / I_kl) on ([Eriksson2013]: isolability). Mechanism l has its learned
form where it is known, with its prior, else the amplitudes of all its formulas together, and no prior. On the diagonal
stands s_k' M s_k: the minimum detectable size. The matrix is not symmetric: a mechanism of many numbers imitates one of
few numbers more closely than the other way round.

**Domain** of something that no cause explains: data, drive, body, water, or out of the plane. The basis of a domain is
what the amplitudes of all its causes, of formulas and of learned forms, do to the prediction to first order, beyond the
coefficients. With the cleared residual z, the projector M_D off such a basis, the span P of all bases and of the
omnibus basis, and its rank r behind the one,

    what a domain leaves = |P M_D z|^2 - r

A domain is stated where it leaves little of what there is to explain, and every other domain leaves much: their bases
have unequal numbers of columns, and the margin between the two shares makes up for it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np

from mjfish.diagnosis.evidence import DETECTED, Evidence, signature_rows
from mjfish.diagnosis.failures import tried
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects.effect import Effect
from mjfish.effects.mechanism import MECHANISMS, Domain
from mjfish.estimation import Fit, Problem
from mjfish.numerics.arrays import FloatArray, blocks_of, solve
from mjfish.numerics.block_angular import Basis, BlockAngular, span
from mjfish.parameters import Parameter

#: Share of a signature's energy below which what is left of it is rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Isolability:
    """Sizes from which mechanisms are told from one another with 90 % power.

    Attributes:
        mechanisms: names (k,).
        amplitudes: full names of the amplitudes (k,) whose sizes these are: the typical directions.
        units: of the amplitudes (k,).
        sizes: (k, k) in these units; row: the mechanism that acts, column: the one that it is told from. On the
            diagonal: from nothing but the coefficients. Infinite where no size tells them apart.
    """

    mechanisms: tuple[str, ...] = ()
    amplitudes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    sizes: tuple[tuple[float, ...], ...] = ()

    @property
    def ratios(self) -> FloatArray:
        """How many times larger a mechanism must be because of another one (k, k); infinite where it is not told."""
        sizes: FloatArray = np.nan_to_num(
            np.reshape(self.sizes, (len(self.mechanisms),) * 2), nan=np.inf, posinf=np.inf
        )
        seen = np.isfinite(np.diag(sizes))
        ratios = np.full_like(sizes, np.inf)
        ratios[seen] = sizes[seen] / np.diag(sizes)[seen, None]
        return ratios

    def hardest(self, count: int) -> list[tuple[int, int]]:
        """Return row and column of the largest finite ratios of two mechanisms, largest first."""
        ratios = self.ratios
        pairs = [(int(row), int(column)) for row, column in np.argwhere(np.isfinite(ratios)) if row != column]
        return sorted(pairs, key=lambda pair: -float(ratios[pair]))[:count]


def isolability(evidence: Evidence, learned: Sequence[Effect] = ()) -> Isolability:
    """Return the isolability of the mechanisms of all candidates at the fit of the nominal model.

    Args:
        evidence: of the formulas.
        learned: causes of learned form; without one, a mechanism has its formulas only.
    """
    effects = (*evidence.candidates, *learned)
    energy, left = amplitude_signatures(evidence, learned)
    return isolated(left.T @ left, energy, effects)


def amplitude_signatures(evidence: Evidence, learned: Sequence[Effect]) -> tuple[FloatArray, FloatArray]:
    """Return, of the signatures of all amplitudes, of formulas, then of learned forms, the squared lengths (d,).

    And what the coefficients leave of them (n, d).

    Those of a cause that is not smooth at its null are the change of the prediction by one scale of the amplitude.
    """
    problem, fit = evidence.problem, evidence.fit
    effects = (*evidence.candidates, *learned)
    raw = np.hstack([evidence.raw, signature_rows(problem, fit.values, learned)])
    rough = [(effect, block) for effect, block in zip(effects, _blocks(effects), strict=True) if not effect.smooth]
    nominal = problem.rough.residual(fit.x) if rough else fit.residual
    for effect, block in rough:
        raw[:, block] = nominal[:, None] - tried(
            [effect.name], partial(_stepped, problem.rough, fit, effect), nominal[:, None]
        )
    energy, inside = np.einsum("nd,nd->d", raw, raw), evidence.coefficients.coordinates(raw)
    for rows in (*problem.trial_rows, *np.arange(problem.measured, len(raw))[:, None]):
        raw[rows] = evidence.coefficients.off_at(rows, raw, inside)
    return energy, raw


def _stepped(problem: Problem, fit: Fit, effect: Effect) -> FloatArray:
    """Return the whitened residuals (n, k) with each amplitude at one scale from its null."""
    wide = replace(problem, model=problem.model.extended(effect))
    null = {**{p.name: p.default for p in effect.parameters}, **fit.values}
    steps = ({**null, p.name: p.default + p.scale} for p in effect.amplitudes())
    return np.stack([wide.residual(wide.start(values)) for values in steps], axis=1)


def isolated(
    information: FloatArray, energy: FloatArray, effects: Sequence[Effect], along: Collection[str] = ()
) -> Isolability:
    """Return the isolability of the mechanisms of causes from the information on their amplitudes.

    Args:
        information: (d, d) S' M S of all causes' amplitudes in units of scale, stacked in the order of the causes.
        energy: (d,) squared norms of S, before the projection.
        effects: the causes.
        along: full names of the amplitudes whose sizes are asked for, one a mechanism; empty: the typical ones.
    """
    mechanisms = tuple(_ordered(effects))
    declared = [p for effect in effects for p in effect.amplitudes()]
    own = np.diag(information)
    shown = np.where(own > _ROUNDING * energy, own, 0.0)
    columns = [_columns(effects, name) for name in mechanisms]
    chosen = np.where([p.name in along for p in declared], np.maximum(own, 1e-300), 0.0) if along else shown
    typical = [_typical(formulas or learned, chosen) for formulas, learned in columns]
    bases = [[j for form in learned or formulas for j in form if shown[j] > 0.0] for formulas, learned in columns]
    penalised = information + prior_precision(effects, declared)
    left = np.tile(shown[typical][:, None], len(mechanisms))
    for l, basis in enumerate(bases):  # noqa: E741 - the equation's
        mixed = information[np.ix_(basis, typical)]
        hidden = np.sum(mixed * solve(penalised[np.ix_(basis, basis)], mixed, _ROUNDING), axis=0)
        others = np.arange(len(mechanisms)) != l
        left[others, l] -= hidden[others]
    told = left > _ROUNDING * np.maximum(shown[typical][:, None], 1e-300)
    scales = np.array([declared[j].scale for j in typical])
    sizes = np.where(told, np.sqrt(DETECTED / np.where(told, left, 1.0)) * scales[:, None], np.inf)
    return Isolability(
        mechanisms=mechanisms,
        amplitudes=tuple(declared[j].name for j in typical),
        units=tuple(declared[j].unit for j in typical),
        sizes=tuple(tuple(map(float, row)) for row in sizes),
    )


def _ordered(effects: Sequence[Effect]) -> Iterator[str]:
    """Yield the names of the mechanisms: those of the table from data to water, then others."""
    found = dict.fromkeys(effect.mechanism for effect in effects)
    yield from (name for name in MECHANISMS if name in found)
    yield from (name for name in found if name not in MECHANISMS)


def _blocks(effects: Sequence[Effect]) -> list[slice]:
    return blocks_of([len(effect.amplitudes()) for effect in effects])


def _columns(effects: Sequence[Effect], mechanism: str) -> tuple[list[range], list[range]]:
    """Return where the amplitudes of every formula, and of every learned form, of a mechanism stand."""
    own = [
        (e, range(b.start, b.stop)) for e, b in zip(effects, _blocks(effects), strict=True) if e.mechanism == mechanism
    ]
    return [at for effect, at in own if not effect.learned], [at for effect, at in own if effect.learned]


def _typical(forms: Sequence[range], shown: FloatArray) -> int:
    """Return the amplitude that is shown best of the first form that is shown at all, else of the first one."""
    form = next((form for form in forms if np.any(shown[form] > 0.0)), forms[0])
    return max(form, key=lambda j: float(shown[j]))


def prior_precision(effects: Sequence[Effect], declared: Sequence[Parameter]) -> FloatArray:
    """Return the precision (d, d) of the priors of all amplitudes, in units of their scales."""
    places = {p.name: j for j, p in enumerate(declared)}
    precision = np.zeros((len(declared), len(declared)))
    for prior in (prior for effect in effects for prior in effect.priors()):
        kept = [k for k, name in enumerate(prior.parameters) if name in places]
        at = [places[prior.parameters[k]] for k in kept]
        rows = prior.rows[:, kept] * np.array([declared[j].scale for j in at]) / prior.sd
        precision[np.ix_(at, at)] += rows.T @ rows
    return precision


def explaining_domain(evidence: Evidence, learned: Sequence[Effect]) -> Domain | None:
    """Return the one domain whose basis explains the residual of the nominal model; None where none or several do.

    Args:
        evidence: of the nominal model, with the formulas of all domains.
        learned: causes of learned form.
    """
    _, left = amplitude_signatures(evidence, learned)
    cleared, jacobian = evidence.cleared, evidence.jacobian
    effects = (*evidence.candidates, *learned)
    slices = blocks_of([len(effect.amplitudes()) for effect in effects])
    every = span(jacobian.beside(BlockAngular.of(left)).beside(evidence.waves.columns))
    whole = _excess(every, evidence.coefficients, cleared)
    shares = {}
    for domain in get_args(Domain):
        own = [np.arange(at.start, at.stop) for e, at in zip(effects, slices, strict=True) if e.domain == domain]
        columns = np.concatenate([np.zeros(0, dtype=np.int64), *own])
        basis = span(jacobian.beside(BlockAngular.of(left[:, columns])))
        shares[domain] = _excess(every, basis, cleared) / max(whole, 1e-300)
    return sole_domain(shares) if whole > 0.0 else None


def _excess(every: Basis, basis: Basis, cleared: FloatArray) -> float:
    """Return what the span of all columns explains beyond chance of a residual, behind a basis in it."""
    return every.explained(cleared) - basis.explained(cleared) - float(every.rank - basis.rank)


def sole_domain(shares: dict[Domain, float]) -> Domain | None:
    """Return the domain that leaves little where all others leave much, of the share that each leaves."""
    best, *others = sorted(shares, key=lambda domain: shares[domain])
    apart = all(shares[domain] > THRESHOLDS.resembles for domain in others)
    return best if shares[best] < THRESHOLDS.remaining and apart else None
