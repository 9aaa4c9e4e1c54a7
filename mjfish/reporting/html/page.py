"""The page: what every section shows, put into the template; one file without a reference to anything outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.select import GOODNESS, KEEP
from mjfish.files import write_text
from mjfish.reporting.html import template
from mjfish.reporting.html.beat import beat_figure
from mjfish.reporting.html.candidates import candidate_views, parameter_views
from mjfish.reporting.html.coefficients import coefficient_views
from mjfish.reporting.html.experiments import experiments
from mjfish.reporting.html.force import force_figure, force_shares
from mjfish.reporting.html.gain import gain_view
from mjfish.reporting.html.series import trial_figures
from mjfish.reporting.html.where import where_view
from mjfish.reporting.html.words import VERDICTS, chance, number


def write_report(diagnosis: Diagnosis, path: Path) -> None:
    """Write the report of a diagnosis as one HTML file, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render(diagnosis))


def render(diagnosis: Diagnosis) -> str:
    """Return the report of a diagnosis as HTML: self-contained, everything that came from a user escaped."""
    return template.render("page.html.j2", **_view(diagnosis))


def _view(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return what the template may use."""
    return {
        "diagnosis": diagnosis,
        "badge": VERDICTS[diagnosis.verdict],
        "p_wrong": chance(diagnosis.p_wrong),
        "causes": [(cause, parameter_views(cause.parameters)) for cause in diagnosis.causes],
        "gain": gain_view(diagnosis),
        "trials": trial_figures(diagnosis),
        "beat": beat_figure(diagnosis),
        "where": where_view(diagnosis),
        "force": force_figure(diagnosis),
        "force_shares": force_shares(diagnosis),
        "candidates": candidate_views(diagnosis),
        "keep": number(KEEP, 1),
        "goodness": number(GOODNESS, 1),
        "experiments": experiments(diagnosis),
        "coefficients": coefficient_views(diagnosis),
        "sampled": sum(len(overlay.trial.time) for overlay in diagnosis.overlays),
    }
