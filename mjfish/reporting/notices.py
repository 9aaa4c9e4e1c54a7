"""What a reader must know before believing a diagnosis: what JSON, terminal and page all say, in one list."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjfish.diagnosis import DiagnosisData


def notices(diagnosis: DiagnosisData) -> tuple[tuple[str, str, str], ...]:
    """Return a status that is not good, then all findings about the data, worst first, then all remarks.

    Each with its kind (``status``, ``remark`` of the diagnosis, or the severity of a finding: ``blocks``, ``suspect``
    or ``remark``), its source (``fit``, ``data`` or ``diagnosis``) and its text.
    """
    status = () if diagnosis.status == "ok" else (("status", "fit", f"{diagnosis.status}: {diagnosis.caution}"),)
    findings = ((f.severity, "data", f"{f.code}: {f.message}") for f in diagnosis.checks.findings)
    return (*status, *findings, *(("remark", "diagnosis", remark) for remark in diagnosis.remarks))
