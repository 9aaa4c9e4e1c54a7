"""The page of a diagnosis: its sections, and what their templates show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import plotly.graph_objects as go

from mjfish.diagnosis import DiagnosisData, Estimate, Splits
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.diagnosis.where import FIFTHS
from mjfish.files.writing import write_text
from mjfish.numerics.formats import CHANNEL_NAMES, channel_name
from mjfish.reporting.html import readings
from mjfish.reporting.html.candidates import detectable, grouped, possible, remark, rivals
from mjfish.reporting.html.curves import FormRow, form_rows
from mjfish.reporting.html.figures import force_figure, overlay_figure, path_figure, worst_path
from mjfish.reporting.html.methods import methods
from mjfish.reporting.html.misfit import beat_figure, speed_figure, stretch_figure, worst_stretch
from mjfish.reporting.html.pages import render
from mjfish.reporting.titles import VERDICTS, cause_title, headline, mechanism_title, notices

_PARTS = ("start-up", "transition", "steady")


def write_diagnosis(diagnosis: DiagnosisData, path: Path, splits: Splits | None = None) -> None:
    """Write the page of a diagnosis, with its splits where there are some, as one HTML file, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render_diagnosis(diagnosis, splits))


def render_diagnosis(diagnosis: DiagnosisData, splits: Splits | None = None) -> str:
    """Return the page of a diagnosis as HTML: self-contained, everything that came from a user escaped."""
    overlays = sorted(diagnosis.overlays, key=lambda overlay: not overlay.held_out)
    names = [*diagnosis.nominal, *(name for name in diagnosis.extended if name not in diagnosis.nominal)]
    setup, knots = diagnosis.setup, diagnosis.setup.knots
    densest = diagnosis.where.trial if diagnosis.where is not None else ""
    forces = sorted(diagnosis.force, key=lambda missing: missing.trial != densest)
    forms = form_rows(diagnosis.mechanisms)
    return render(
        "diagnosis.html.j2",
        diagnosis=diagnosis,
        parts=parts(diagnosis, splits),
        splits=splits,
        badge=VERDICTS[diagnosis.verdict],
        headline=headline(diagnosis),
        title=lambda name: cause_title(name, setup.causes),
        mechanism_title=lambda name: mechanism_title(name, setup.causes),
        picture=picture(diagnosis, forms),
        readings=readings,
        sampled=sum(len(overlay.trial.time) for overlay in diagnosis.overlays),
        channel_name=channel_name,
        notices=notices(diagnosis),
        rivals=rivals(diagnosis),
        trials=[(overlay, overlay_figure(diagnosis, overlay)) for overlay in overlays],
        trial_names=[f"{o.trial.name}{' (held out)' if o.held_out else ''}" for o in overlays],
        beat=beat_figure(diagnosis),
        speed=speed_figure(diagnosis),
        where=shares(diagnosis),
        forces=[(missing.trial, force_figure(missing)) for missing in forces],
        effects=setup.causes,
        chosen=possible(diagnosis),
        grouped=grouped(diagnosis),
        remark=lambda candidate: remark(candidate, diagnosis),
        detectable=lambda candidate: detectable(candidate, diagnosis),
        limits=THRESHOLDS,
        declared=setup.parameters,
        names=[name for name in names if name not in knots],
        knots=knots,
        unread=len(knots.intersection(names)),
        forms=forms,
        whiskers=whiskers,
        methods=methods(diagnosis),
    )


def parts(diagnosis: DiagnosisData, splits: Splits | None) -> list[tuple[str, str]]:
    """Return the sections that the page of a diagnosis has, in order: the name of each and its title."""
    held_out = "What the extended model gains" if diagnosis.best else "Error on held-out trials"
    found = (
        ("notices", "Findings and remarks", True),
        ("rivals", "Rivals side by side", rivals(diagnosis)),
        ("form", "Form", any(mechanism.curves for mechanism in diagnosis.mechanisms)),
        ("gain", held_out, diagnosis.best or diagnosis.gain),
        ("splits", "How firmly the verdict is held", splits is not None),
        ("trials", "Measured against simulated", True),
        ("residuals", "What is left over beat and speed", diagnosis.setup.velocities),
        ("where", "Where the nominal model goes wrong", diagnosis.where is not None),
        ("force", "What the nominal model lacks, as a force", diagnosis.force),
        ("candidates", "Every candidate", diagnosis.candidates),
        ("evidence", "What the verdict is read from", diagnosis.table.rows),
        ("isolability", "What these runs can tell apart", True),
        ("coefficients", "Coefficients", True),
        ("methods", "Methods", True),
        ("provenance", "Provenance", True),
    )
    return [(name, title) for name, title, there in found if there]


def picture(diagnosis: DiagnosisData, forms: Sequence[FormRow]) -> tuple[str, go.Figure, readings.Reading]:
    """Return the picture of the first screen: its title, figure, and how to read it.

    It is the learned curve, where one is named; else the stretch on which the nominal model is worst.

    Of places, the path of the run on which it is.
    """
    if forms and any(mechanism.form == "learned" for mechanism in diagnosis.mechanisms):
        first = forms[0][1][0]
        return (first.title, first.figure, readings.CURVE)
    if not diagnosis.setup.velocities and (worst := worst_path(diagnosis)) is not None:
        run, places = worst
        trial = f"{'held-out ' if run.held_out else ''}trial {run.trial.name}"
        return (f"Path in {trial}: where the nominal model is worst", path_figure(diagnosis, places), readings.PATH)
    stretch = worst_stretch(diagnosis)
    return (stretch.title, stretch_figure(diagnosis, stretch), readings.STRETCH)


def shares(diagnosis: DiagnosisData) -> list[tuple[str, str, dict[str, float]]]:
    """Return where the misfit sits: title of each group, where it is densest, and all shares of it in order."""
    if (where := diagnosis.where) is None:
        return []
    trials = [overlay.trial.name for overlay in diagnosis.overlays]
    named = {channel_name(name): share for name, share in where.channels.items()}
    return [
        ("channel", channel_name(where.channel), _in_order(named, CHANNEL_NAMES.values())),
        ("trial", where.trial, _in_order(where.trials, trials)),
        ("part of the run", where.part, _in_order(where.parts, _PARTS)),
        ("phase of the beat", where.phase, _in_order(where.phases, sorted(where.phases))),
        ("surge", where.speed, _in_order(where.speeds, FIFTHS)),
        ("|yaw rate|", where.turn, _in_order(where.turns, FIFTHS)),
    ]


def _in_order(found: dict[str, float], order: Iterable[str]) -> dict[str, float]:
    """Return the shares in this order, those of other names behind."""
    return {name: found[name] for name in (*(n for n in order if n in found), *found)}


def whiskers(*estimates: Estimate) -> list[dict[str, float]]:
    """Place estimates and their intervals on one line, in percent of its width, with a margin at both ends."""
    low, high = min(e.low for e in estimates), max(e.high for e in estimates)

    def place(value: float) -> float:
        return round(6.0 + 88.0 * min(max((value - low) / max(high - low, 1e-300), 0.0), 1.0), 2)

    return [{"at": place(e.estimate), "low": place(e.low), "high": place(e.high)} for e in estimates]
