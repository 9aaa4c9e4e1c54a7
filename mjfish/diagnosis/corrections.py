"""Corrections of the data that findings propose, as rows of the table: a flipped channel is a hypothesis like a cause.

The nominal model is fitted to the data as they stand and as they would be if the finding were true, each under the
white noise sigma that its third differences show. Of the numbers y as they were measured, n of every channel c,

    log L = - 1/2 |r|^2 - n sum_c log sigma_c + sum_runs n_r sum_c log |y_c|,

up to a constant that both have: the last term is the Jacobian of a change of units. Twice what a correction adds is its
evidence. A finding whose correction explains no more than chance does blocks nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset
from mjfish.diagnosis.evidence import tail
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.estimation import Fit, Noise, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.identification import first_sigma
from mjfish.estimation.nominal import nominal_problem
from mjfish.inspection import Finding

#: Keeps the logarithm of a channel that stands still finite.
_NOTHING = 1e-300


def weighed(blocks: tuple[Finding, ...], dataset: Dataset) -> tuple[dict[Finding, Finding], tuple[Row, ...]]:
    """Return the refuted findings as suspects, and a row for every correction whose fit did not diverge.

    Args:
        blocks: findings with which no verdict could be given.
        dataset: as it was measured.
    """
    rows = dict(_rows(blocks, dataset))
    refuted = {finding: _refuted(finding) for finding, row in rows.items() if row.p_value >= THRESHOLDS.keep}
    return refuted, tuple(rows.values())


def _refuted(finding: Finding) -> Finding:
    found = f"{finding.found}; yet corrected so, the nominal model fits no better"
    return replace(finding, severity="suspect", found=found)


def _rows(blocks: tuple[Finding, ...], dataset: Dataset) -> Iterator[tuple[Finding, Row]]:
    """Yield the findings that propose a correction, and their rows."""
    proposed = [(finding, finding.corrected(dataset)) for finding in blocks if finding.corrected is not None]
    if not proposed:
        return
    nominal = _fitted(dataset)
    for finding, corrected in proposed:
        found = _fitted(corrected)
        if not (nominal.lost or found.lost):
            yield finding, _row(finding, 2.0 * (_likelihood(found, corrected) - _likelihood(nominal, dataset)), found)


def _fitted(dataset: Dataset) -> Fit:
    """Fit the nominal model to all trials, for held-out ones may be read wrongly, too."""
    dataset = aligned(dataset)
    problem = nominal_problem(dataset, dataset.trials, Noise.white(first_sigma(dataset.trials)))
    return fit(problem, problem.start(), tolerance=1e-4)


def _likelihood(found: Fit, dataset: Dataset) -> float:
    """Return log L of a fit to a dataset; channels that were not measured do not count."""
    spread = np.log(first_sigma(dataset.trials))
    sizes = [
        len(trial.time) * (np.log(np.linalg.norm(trial.velocity, axis=0) + _NOTHING) - spread)
        for trial in dataset.trials
    ]
    return float(np.nansum(sizes) - 0.5 * found.sse)


def _row(finding: Finding, gain: float, found: Fit) -> Row:
    """Return the row of a correction; the choice counts as one parameter."""
    name, rank = f"{finding.code} ({finding.place})", found.count - len(found.x)
    return replace(
        Row.apart(name, finding.found, finding.code, gain, found.status),
        tests={"noise": tail(found.sse, rank)},
        excess=max(found.sse - rank, 0.0),
        rank=rank,
    )
