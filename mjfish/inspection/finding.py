"""Findings about the data: where, what, what was expected, what to do; with stable codes, and the causes they concern.

And datasets as they would be if what a finding says of them were true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from mjfish.data import Dataset, Trial
from mjfish.files.plain_data import fields_of, unsaved

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
