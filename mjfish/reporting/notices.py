"""What a reader must know before believing a diagnosis: what JSON, terminal and page all say, in one list."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.diagnosis import DiagnosisData


@dataclass(frozen=True)
class Notice:
    """One of them.

    Attributes:
        kind: ``status``, ``remark`` of the diagnosis, or the severity of a finding about the data: ``blocks``,
            ``suspect`` or ``remark``.
        source: ``fit``, ``data`` or ``diagnosis``.
        text: in words.
    """

    kind: str
    source: str
    text: str


def notices(diagnosis: DiagnosisData) -> tuple[Notice, ...]:
    """Return a status that is not good, then all findings about the data, worst first, then all remarks."""
    status = () if diagnosis.status == "ok" else (Notice("status", "fit", diagnosis.status),)
    findings = (Notice(finding.severity, "data", finding.message) for finding in diagnosis.checks.findings)
    return (*status, *findings, *(Notice("remark", "diagnosis", remark) for remark in diagnosis.remarks))
