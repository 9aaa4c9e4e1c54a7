"""Corrections of the data that findings propose, as rows of the table: a flipped channel is a hypothesis like a cause.

The nominal model is fitted to the data as they stand and as they would be if the finding were true, each under the
white noise that its third differences show. This noise goes with the unit and the column of a channel, so that the fall
of the sum of squares is the likelihood ratio of the same measured numbers. A finding whose correction explains no more
than chance does blocks nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset
from mjfish.diagnosis.evidence import tail
from mjfish.diagnosis.table import THRESHOLDS, Row
from mjfish.estimation import Fit, Noise, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.identification import first_sigma
from mjfish.estimation.nominal import nominal_problem
from mjfish.inspection import Finding


def weighed(blocks: tuple[Finding, ...], dataset: Dataset) -> tuple[dict[Finding, Finding], tuple[Row, ...]]:
    """Return what becomes of the findings that do not block after all, and a row for each that proposes a correction.

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
    """Yield findings that propose a correction, and their rows; one is left out where the nominal model diverges."""
    proposed = [(finding, finding.corrected) for finding in blocks if finding.corrected is not None]
    nominal = _fitted(dataset) if proposed else None
    for finding, corrected in proposed:
        found = _fitted(corrected(dataset))
        if nominal is not None and not (nominal.lost or found.lost):
            yield finding, _row(finding, nominal, found)


def _fitted(dataset: Dataset) -> Fit:
    """Fit the nominal model to all trials, for held-out ones may be read wrongly, too."""
    problem = nominal_problem(aligned(dataset), dataset.trials, Noise.white(first_sigma(dataset.trials)))
    return fit(problem, problem.start(), tolerance=1e-4)


def _row(finding: Finding, nominal: Fit, found: Fit) -> Row:
    """Return the row of a correction: one choice more, and no parameter."""
    name, gain, rank = f"{finding.code} ({finding.place})", nominal.sse - found.sse, found.count - len(found.x)
    return Row(
        names=(name,),
        causes={name: finding.found},
        mechanisms=(finding.code,),
        learned=False,
        gain=gain,
        degrees_of_freedom=1,
        adjusted=gain,
        behind=np.nan,
        rival_p=np.nan,
        tests={"noise": tail(found.sse, rank)},
        excess=max(found.sse - rank, 0.0),
        rank=rank,
        status=found.status,
    )
