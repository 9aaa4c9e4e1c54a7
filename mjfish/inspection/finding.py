"""What a check of the data found, and all findings together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from mjfish.inspection.compatibility import Compatibility
from mjfish.inspection.repeats import Repeats

#: ``remark``: good to know; ``suspect``: look before you believe a verdict; ``blocks``: no verdict is worth its words.
Severity = Literal["remark", "suspect", "blocks"]
SEVERITIES: tuple[Severity, ...] = ("blocks", "suspect", "remark")

#: Stands for every cause there is, in `Finding.cannot_tell`.
EVERYTHING = "*"


@dataclass(frozen=True)
class Finding:
    """One thing about the data that a reader, or a verdict, must know.

    Attributes:
        check: name of the check that found it.
        severity: ``remark``, ``suspect`` or ``blocks``.
        place: where, as a reader would say it: trial, channel, time.
        found: what is there.
        expected: what would be there in good data.
        remedy: what to do.
        cannot_tell: causes (names of effects, or ``*`` for all) that such data cannot show, or that cannot be told from
            what was found.
        trials: names of the trials it is about; empty: all.
        channels: names of the channels it is about; empty: all.
    """

    check: str
    severity: Severity
    place: str
    found: str
    expected: str
    remedy: str
    cannot_tell: tuple[str, ...] = ()
    trials: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()

    @property
    def message(self) -> str:
        """The finding in one sentence."""
        return f"{self.place}: {self.found}, expected {self.expected}; {self.remedy}"


@dataclass(frozen=True)
class Checks:
    """All findings about a dataset, the worst first.

    Attributes:
        findings: worst first, else in the order in which they were found.
        compatibility: of pose and velocity, where both were measured; None else.
        repeats: the noise that repeated runs show; None where no run was repeated.
    """

    findings: tuple[Finding, ...] = ()
    compatibility: Compatibility | None = None
    repeats: Repeats | None = None

    @property
    def severity(self) -> Severity | None:
        """The worst severity; None where nothing was found."""
        return self.findings[0].severity if self.findings else None

    @property
    def blocks(self) -> tuple[Finding, ...]:
        """Findings with which no verdict is worth its words."""
        return self.of("blocks")

    @property
    def cannot_tell(self) -> frozenset[str]:
        """Causes that some finding puts in doubt; ``*`` among them: all."""
        return frozenset(name for finding in self.findings for name in finding.cannot_tell)

    def of(self, severity: Severity) -> tuple[Finding, ...]:
        """Return the findings of one severity."""
        return tuple(finding for finding in self.findings if finding.severity == severity)

    def joined(self, other: Checks) -> Checks:
        """Return the findings of both; what one says twice is said once."""
        return Checks(
            ordered([*self.findings, *(f for f in other.findings if f not in self.findings)]),
            self.compatibility or other.compatibility,
            self.repeats or other.repeats,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the findings as plain data."""
        return {
            "severity": self.severity,
            "findings": [{**asdict(finding), "message": finding.message} for finding in self.findings],
            "cannot_tell": sorted(self.cannot_tell),
            "compatibility": self.compatibility.to_dict() if self.compatibility else None,
            "repeats": self.repeats.to_dict() if self.repeats else None,
        }


def ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings, the worst first; the order is kept among equals."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))
