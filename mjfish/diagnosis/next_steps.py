"""What to do after a diagnosis, and with how much care to take it: one list for JSON, terminal, page and summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjfish.diagnosis.result import DiagnosisData

#: What to do about a status that is not ok.
CAUTIONS = {
    "fit_not_converged": "a fit has not converged, and the numbers may be off; look for a better optimum with "
    "'mjfish identify DATASET --starts 16', and start from it (table [start] of dataset.toml)",
    "failed": "a part of the diagnosis failed, and nothing is claimed; mend it, or leave it out, and diagnose again",
}
#: What is left to do, by verdict.
_LAST = {
    "named": [
        "simulate with it: mjfish diagnose DATASET --extended extended.toml writes the fish with the cause, mjfish "
        "simulate --fish extended.toml swims it"
    ],
    "nothing_wrong": ["read from which sizes on causes would have been seen"],
    "unexplained": ["describe a cause of your own in a file: mjfish diagnose DATASET --effects my_effects.py"],
}


def next_steps(found: DiagnosisData) -> Iterator[str]:
    """Yield what to do next, the most important first, each as a phrase without a full stop.

    In a command, ``DATASET`` stands for the folder of the dataset.
    """
    if found.failures:
        part, reason = next(iter(found.failures.items()))
        yield f"mend what failed, {part} first ({reason}), or leave it out, and diagnose again"
    yield from (f"mend {finding.place}: {finding.remedy}" for finding in found.checks.blocks)
    suspect = dict.fromkeys(finding.code for finding in found.checks.findings if finding.severity == "suspect")
    if found.verdict == "unexplained" and suspect:
        yield f"mend {' and '.join(suspect)}, it may be the cause"
    if found.verdict in ("cannot_tell", "nothing_wrong"):
        far = "how far they set the rivals apart" if found.rivals else "what they would show that these do not"
        record = "record runs that differ from these: another frequency, a turn, a start from rest"
        yield f"mjfish plan DATASET ranks runs by {far}" if found.setup.plannable else record
    yield from _experiments(found)
    if found.verdict == "unexplained" and found.where is not None:
        yield f"look where the misfit is densest: {found.where.densest}"
    yield from _LAST.get(found.verdict, ())


def _experiments(found: DiagnosisData) -> Iterator[str]:
    """Yield the experiments that settle the named causes, the rivals, or else the cause that comes closest."""
    settles = {"named": "confirm", "unexplained": "test what comes closest,"}.get(found.verdict, "test")
    asked = [cause.name for cause in found.causes] or [name for group in found.rivals for name in group]
    experiments: dict[str, list[str]] = {}
    for name in asked or [found.closest]:
        if name in found.setup.causes:
            experiments.setdefault(found.setup.causes[name].confirm, []).append(name)
    yield from (f"{settles} {' and '.join(names)}: {what}" for what, names in experiments.items())
