"""Which experiment would confirm the cause, or tell the rivals apart."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.diagnosis import Diagnosis
from mjfish.reporting.html.candidates import known_effects


@dataclass(frozen=True)
class Experiment:
    """The experiment for one cause, and why the cause is recognised by it."""

    name: str
    summary: str
    signature: str
    confirm: str
    source: str


def experiments(diagnosis: Diagnosis) -> tuple[Experiment, ...]:
    """Return the experiments for the named cause or for every rival; none for an effect that is not known here."""
    names = [cause.name for cause in diagnosis.causes] or [name for group in diagnosis.rivals for name in group]
    effects = known_effects(diagnosis)
    return tuple(
        Experiment(name, effects[name].summary, effects[name].signature, effects[name].confirm, effects[name].source)
        for name in names
        if name in effects
    )
