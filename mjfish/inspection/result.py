"""All findings about a dataset, with the causes that each of them concerns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from mjfish.effects import Effect
from mjfish.inspection.finding import EVERYTHING, SEVERITIES, Finding, Severity
from mjfish.inspection.kinematics import Compatibility
from mjfish.inspection.repeats import Repeats
from mjfish.result import Result
from mjfish.serialise import fields_of

#: Findings that leave no cause to be told, though they do not block.
_HIDES_ALL = ("design-one-run",)
#: What is looked at, where the channels for it were measured.
_TESTED = (
    "mjfish.inspect looks at signs, units, labels, clocks, sampling, starts, copies, outliers, joints, places, repeats "
    "and missing runs"
)


@dataclass(frozen=True, repr=False)
class Inspection(Result):
    """All findings about a dataset.

    Attributes:
        findings: worst first, else in the order in which they were found.
        compatibility: of pose and velocity, where both were measured; None else.
        repeats: the noise that repeated runs show; None where no run was repeated.
    """

    findings: tuple[Finding, ...] = ()
    compatibility: Compatibility | None = None
    repeats: Repeats | None = None

    @classmethod
    def of(
        cls,
        findings: Iterable[Finding],
        effects: Mapping[str, Effect],
        compatibility: Compatibility | None = None,
        repeats: Repeats | None = None,
    ) -> Inspection:
        """Return the findings in order, each with the causes that it concerns."""
        concerned = [replace(finding, cannot_tell=_concerned(finding, effects)) for finding in findings]
        return cls(_ordered(concerned), compatibility, repeats)

    @property
    def severity(self) -> Severity | None:
        """The worst severity; None where nothing was found."""
        return self.findings[0].severity if self.findings else None

    @property
    def blocks(self) -> tuple[Finding, ...]:
        """Findings with which no verdict can be given."""
        return tuple(finding for finding in self.findings if finding.severity == "blocks")

    def joined(self, other: Inspection) -> Inspection:
        """Return the findings of both; those that are in both once."""
        new = (finding for finding in other.findings if finding not in self.findings)
        return Inspection(
            _ordered([*self.findings, *new]), self.compatibility or other.compatibility, self.repeats or other.repeats
        )

    def changed(self, findings: Mapping[Finding, Finding]) -> Inspection:
        """Return the inspection with other findings in the place of some."""
        return replace(self, findings=_ordered(findings.get(finding, finding) for finding in self.findings))

    def summary(self) -> str:
        """Return what was looked at, how many findings there are, and the worst of them, a line each."""
        if not self.findings:
            return f"Nothing was found in the data ({_TESTED})."
        counts = [(sum(f.severity == severity for f in self.findings), severity) for severity in SEVERITIES]
        head = ", ".join(f"{count} {severity}" for count, severity in counts if count)
        lines = [f"{finding.severity}: {finding.code}: {finding.place}: {finding.found}" for finding in self.findings]
        more = [f"and {len(lines) - 7} more"] if len(lines) > 7 else []
        return "\n".join([f"Findings: {head} ({_TESTED}).", *lines[:7], *more])

    def to_dict(self) -> dict[str, Any]:
        """Return the findings as plain data."""
        return {"severity": self.severity, **fields_of(self)}


def _concerned(finding: Finding, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    if finding.severity == "blocks" or finding.code in _HIDES_ALL:
        return (EVERYTHING,)
    return tuple(sorted(name for name, effect in effects.items() if effect.unclear_under(finding.code)))


def _ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings, the worst first; the order is kept among equals."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))
