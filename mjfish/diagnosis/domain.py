"""The domain of something that no cause explains: data, drive, body, water, or out of the plane.

The basis of a domain is what the amplitudes of all its causes, of formulas and of learned forms, do to the prediction
to first order, beyond the coefficients. With the cleared residual z, the projector M_D off such a basis, the span P of
all bases and of the omnibus basis, and its rank r behind the one,

    what a domain leaves = |P M_D z|^2 - r

A domain is stated where it leaves little of what there is to explain, and every other domain leaves much: their bases
have unequal numbers of columns, and the margin between the two shares makes up for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from mjfish.arrays import FloatArray, blocks_of
from mjfish.block_angular import Basis, BlockAngular, span
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.isolability import amplitude_signatures
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects.effect import Effect
from mjfish.effects.mechanism import Domain


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
    return best if shares[best] < THRESHOLDS.left and apart else None
