"""Words for people: what a cause or a mechanism does, the verdict as a headline, what to know before believing it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mjfish.diagnosis import DiagnosisData
from mjfish.diagnosis.setup import CauseText
from mjfish.effects.mechanism import MECHANISMS

#: How the verdicts read.
VERDICTS = {
    "named": "Cause named",
    "nothing_wrong": "Nothing wrong",
    "cannot_tell": "Cannot tell",
    "unexplained": "Unexplained",
}
#: Most causes that a headline lists.
_LISTED = 3


def cause_title(name: str, causes: Mapping[str, CauseText]) -> str:
    """Return what a cause does, as its class says; its name where the class is not known.

    >>> from mjfish.effects import find
    >>> cause_title("time_offset", {"time_offset": CauseText.of(find("time_offset"))})
    'The clocks of camera and drive are apart'
    """
    return _capital(causes[name].summary if name in causes else name)


def mechanism_title(name: str, causes: Mapping[str, CauseText]) -> str:
    """Return what acts; a cause that is a mechanism by itself says it for both."""
    return _capital(MECHANISMS[name].summary) if name in MECHANISMS else cause_title(name, causes)


def headline(diagnosis: DiagnosisData) -> str:
    """Return the verdict as a reader would say it, without the names of the code."""
    if diagnosis.verdict == "named":
        acting = [mechanism_title(mechanism.name, diagnosis.setup.causes) for mechanism in diagnosis.mechanisms]
        return _listed(acting or [cause_title(cause.name, diagnosis.setup.causes) for cause in diagnosis.causes])
    if diagnosis.verdict == "nothing_wrong":
        return "The data do not contradict the simulation"
    if diagnosis.verdict == "unexplained":
        return "Something is wrong, and no listed cause explains it"
    rivals = [cause_title(name, diagnosis.setup.causes) for group in diagnosis.rivals for name in group]
    if not rivals:
        return "The data cannot tell the cause"
    if len(rivals) > _LISTED:
        return f"One of {len(rivals)} causes, and the data cannot tell which"
    return f"{_listed(rivals, 'or')}: the data cannot tell which"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _listed(titles: Sequence[str], link: str = "and") -> str:
    """Join sentences: the first keeps its capital."""
    first, *others = titles or [""]
    return f", {link} ".join([first, *(title[:1].lower() + title[1:] for title in others)])


def notices(diagnosis: DiagnosisData) -> tuple[tuple[str, str, str], ...]:
    """Return what JSON, terminal and page all say: a status that is not good, findings about the data, remarks.

    The findings are sorted, worst first. Each with its kind (``status``, ``remark`` of the diagnosis, or the severity
    of a finding: ``blocks``, ``suspect``
    or ``remark``), its source (``fit``, ``data`` or ``diagnosis``) and its text.
    """
    status = () if diagnosis.status == "ok" else (("status", "fit", f"{diagnosis.status}: {diagnosis.caution}"),)
    findings = ((f.severity, "data", f"{f.code}: {f.message}") for f in diagnosis.checks.findings)
    return (*status, *findings, *(("remark", "diagnosis", remark) for remark in diagnosis.remarks))
