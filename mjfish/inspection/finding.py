"""Findings about the data: where, what, what was expected, what to do; with stable codes, and the causes they concern.

And datasets as they would be if what a finding says of them were true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from mjfish.data import Dataset, Trial
from mjfish.effects import Effect
from mjfish.files.plain_data import fields_of, unsaved
from mjfish.files.result import Result

if TYPE_CHECKING:
    from mjfish.inspection.kinematics import Compatibility
    from mjfish.inspection.repeats import Repeats

#: ``remark``: good to know; ``suspect``: look before you believe a verdict; ``blocks``: no verdict can be given.
Severity = Literal["remark", "suspect", "blocks"]
SEVERITIES: tuple[Severity, ...] = ("blocks", "suspect", "remark")

#: Stands for every cause in `Finding.cannot_tell`.
EVERYTHING = "*"


@dataclass(frozen=True)
class Finding:
    """One thing about the data that a reader, or a verdict, must know.

    Attributes:
        code: stable name of the finding, such as ``clock-jump``.
        severity: ``remark``, ``suspect`` or ``blocks``.
        place: where: trial, channel, time.
        found: what is there.
        expected: what good data have there.
        remedy: what to do.
        trials: names of the trials it is about; empty: all.
        channels: names of the channels it is about; empty: all.
        cannot_tell: causes (names of effects, or ``*`` for all) that such data cannot show, or that look like what was
            found. `Inspection.of` fills it in from what the effects declare.
        corrected: returns a dataset as it would be if the finding were true; None: nobody can say that.
    """

    code: str
    severity: Severity
    place: str
    found: str
    expected: str
    remedy: str
    trials: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    cannot_tell: tuple[str, ...] = ()
    corrected: Callable[[Dataset], Dataset] | None = unsaved(default=None, compare=False, repr=False)

    @property
    def message(self) -> str:
        """The finding in one sentence."""
        return f"{self.place}: {self.found}, expected {self.expected}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as plain data, with its message."""
        return {**fields_of(self), "message": self.message}


def changed(dataset: Dataset, changes: Mapping[str, Callable[[Trial], Trial]]) -> Dataset:
    """Return the dataset with some of its trials changed, by name."""
    return replace(dataset, trials=tuple(changes[t.name](t) if t.name in changes else t for t in dataset.trials))


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
    if finding.severity == "blocks" or finding.code == "design-one-run":  # it leaves no cause to be told either
        return (EVERYTHING,)
    return tuple(sorted(name for name, effect in effects.items() if effect.unclear_under(finding.code)))


def _ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings, the worst first; the order is kept among equals."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))
