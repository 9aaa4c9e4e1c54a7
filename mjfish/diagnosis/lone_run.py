"""The run that holds all of a misfit: something happened in it that is in no other.

Two causes and more, fitted to all runs, can imitate what was odd in one. Without the rows of a run, and with the
coefficients refitted to first order on the others, the joint score of all candidates and the omnibus basis say whether
the others contradict the nominal model at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.block_angular import BlockAngular, span
from mjfish.diagnosis.evidence import Evidence, whitened_omnibus
from mjfish.diagnosis.select import GOODNESS

#: Fewest runs of which one can be the odd one.
_FEWEST = 4


def lone_run(evidence: Evidence) -> int | None:
    """Return the index of the fitted trial without which nothing contradicts the nominal model; None: of no other one.

    Args:
        evidence: of the nominal model.
    """
    if len(evidence.problem.trials) < _FEWEST:
        return None
    waves = whitened_omnibus(evidence.problem).dense()
    alone = []
    for index in range(len(evidence.problem.trials)):
        others = _without(evidence, waves, ~evidence.problem.rows_of({index}))
        if min(others.saturated_p(), others.omnibus_p()) >= GOODNESS:
            alone.append(index)
    return alone[0] if len(alone) == 1 else None


def _without(evidence: Evidence, waves: np.ndarray, kept: np.ndarray) -> Evidence:
    """Return the evidence of the rows kept (n,) alone."""
    fit = evidence.fit
    jacobian = fit.jacobian.dense()[kept][:, ~fit.at_bound]
    coefficients = span(BlockAngular.of(jacobian))
    cleared = coefficients.off(fit.residual[kept])
    signatures, own = coefficients.off(evidence.raw[kept]), coefficients.off(waves[kept])
    return replace(
        evidence,
        cleared=cleared,
        score=signatures.T @ cleared,
        information=signatures.T @ signatures,
        raw=evidence.raw[kept],
        signatures=signatures,
        omnibus_score=own.T @ cleared,
        omnibus_information=own.T @ own,
        coefficients=coefficients,
    )
