"""The sets of causes that a diagnosis cannot tell apart, side by side."""

from __future__ import annotations

from mjfish.diagnosis import DiagnosisData
from mjfish.diagnosis.table import Row


def rivals(diagnosis: DiagnosisData) -> list[tuple[tuple[str, ...], Row | None]]:
    """Return the sets that stay with their rows of evidence, where there are several and none is named.

    The one that is the extended model of the figures comes first.
    """
    if diagnosis.verdict != "cannot_tell" or len(diagnosis.alternatives) < 2:
        return []
    rows = {frozenset(row.names): row for row in diagnosis.table.rows}
    every = [(names, rows.get(frozenset(names))) for names in diagnosis.alternatives]
    return sorted(every, key=lambda rival: {*rival[0]} != {*diagnosis.best})
