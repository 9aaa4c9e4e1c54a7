"""The page of a diagnosis: its sections, and what their templates show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go

from mjfish.diagnosis import DiagnosisData, Estimate, Splits
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.diagnosis.where import FIFTHS
from mjfish.files import write_text
from mjfish.reporting.html import readings
from mjfish.reporting.html.candidates import detectable, grouped, possible, remark
from mjfish.reporting.html.curves import FormRow, form_rows
from mjfish.reporting.html.figures import force_figure, overlay_figure, path_figure, worst_path
from mjfish.reporting.html.methods import methods
from mjfish.reporting.html.pages import render
from mjfish.reporting.html.residuals import beat_figure, speed_figure
from mjfish.reporting.html.rivals import rivals
from mjfish.reporting.html.worst_stretch import stretch_figure, worst_stretch
from mjfish.reporting.notices import notices
from mjfish.reporting.titles import cause_title, headline, mechanism_title
from mjfish.reporting.words import CHANNEL_NAMES, VERDICTS, channel_name

_PARTS = ("start-up", "transition", "steady")


@dataclass(frozen=True)
class Part:
    """A section of the page.

    Attributes:
        id: of its place on the page.
        title: its heading.
        template: that shows it.
    """

    id: str
    title: str
    template: str


@dataclass(frozen=True)
class Picture:
    """The picture of the first screen."""

    title: str
    figure: go.Figure
    reading: readings.Reading


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
        errors=errors(diagnosis),
        notices=notices(diagnosis),
        rivals=rivals(diagnosis),
        channel_names=CHANNEL_NAMES,
        trials=[(overlay, overlay_figure(diagnosis, overlay)) for overlay in overlays],
        trial_names=[f"{o.trial.name}{' (held out)' if o.held_out else ''}" for o in overlays],
        beat=beat_figure(diagnosis),
        speed=speed_figure(diagnosis),
        where=shares(diagnosis),
        forces=_forces(diagnosis),
        effects=setup.causes,
        chosen=possible(diagnosis),
        grouped=grouped(diagnosis),
        remark=lambda candidate: remark(candidate, diagnosis),
        detectable=lambda candidate: detectable(candidate, diagnosis),
        limits=THRESHOLDS,
        experiments=experiments(diagnosis),
        bench=bench(diagnosis),
        declared=setup.parameters,
        names=[name for name in names if name not in knots],
        knots=knots,
        unread=len(knots.intersection(names)),
        forms=forms,
        whiskers=whiskers,
        methods=methods(diagnosis),
    )


def parts(diagnosis: DiagnosisData, splits: Splits | None) -> list[Part]:
    """Return the sections that the page of a diagnosis has, in order."""
    experiment = "What would tell them apart" if diagnosis.verdict == "cannot_tell" else "What would confirm it"
    held_out = "What the extended model gains" if diagnosis.best else "Error on held-out trials"
    found = (
        (Part("notices", "Findings and remarks", "notices.html.j2"), True),
        (Part("rivals", "Rivals side by side", "rivals.html.j2"), rivals(diagnosis)),
        (Part("experiments", experiment, "experiments.html.j2"), experiments(diagnosis)),
        (Part("form", "Form", "form.html.j2"), any(mechanism.curves for mechanism in diagnosis.mechanisms)),
        (Part("gain", held_out, "gain.html.j2"), diagnosis.best or diagnosis.gain),
        (Part("splits", "How firmly the verdict is held", "splits.html.j2"), splits is not None),
        (Part("trials", "Measured against simulated", "trials.html.j2"), True),
        (Part("residuals", "What is left over beat and speed", "residuals.html.j2"), diagnosis.setup.velocities),
        (Part("where", "Where the nominal model goes wrong", "where.html.j2"), diagnosis.where is not None),
        (Part("force", "What the nominal model lacks, as a force", "force.html.j2"), diagnosis.force),
        (Part("candidates", "Every candidate", "candidates.html.j2"), diagnosis.candidates),
        (Part("evidence", "What the verdict is read from", "evidence.html.j2"), diagnosis.table.rows),
        (Part("isolability", "What these runs can tell apart", "isolability.html.j2"), True),
        (Part("coefficients", "Coefficients", "coefficients.html.j2"), True),
        (Part("methods", "Methods", "methods.html.j2"), True),
        (Part("provenance", "Provenance", "provenance.html.j2"), True),
    )
    return [part for part, there in found if there]


def picture(diagnosis: DiagnosisData, forms: list[FormRow]) -> Picture:
    """Return the learned curve, where one is named; else the stretch on which the nominal model is worst.

    Of places, the path of the run on which it is.
    """
    if forms and any(mechanism.form == "learned" for mechanism in diagnosis.mechanisms):
        first = forms[0].figures[0]
        return Picture(first.title, first.figure, readings.CURVE)
    if not diagnosis.setup.velocities and (run := worst_path(diagnosis)) is not None:
        held_out = "held-out " if run.held_out else ""
        title = f"Path in {held_out}trial {run.trial.name}: where the nominal model is worst"
        return Picture(title, path_figure(diagnosis, run), readings.PATH)
    stretch = worst_stretch(diagnosis)
    return Picture(stretch.title, stretch_figure(diagnosis, stretch), readings.STRETCH)


def experiments(diagnosis: DiagnosisData) -> list[str]:
    """Return the causes whose bench experiments settle the verdict: the named ones, or else the rivals."""
    asked = [cause.name for cause in diagnosis.causes] or [name for group in diagnosis.rivals for name in group]
    return [name for name in asked if name in diagnosis.setup.causes]


def bench(diagnosis: DiagnosisData) -> dict[str, list[str]]:
    """Return what the causes do that each of these experiments settles; where none explains, the closest."""
    found: dict[str, list[str]] = {}
    causes = diagnosis.setup.causes
    for name in experiments(diagnosis) or [name for name in (diagnosis.closest,) if name in causes]:
        found.setdefault(causes[name].confirm, []).append(cause_title(name, causes))
    return found


def _forces(diagnosis: DiagnosisData) -> list[tuple[str, go.Figure]]:
    """Return the missing force of every trial; first where the misfit is densest."""
    densest = diagnosis.where.trial if diagnosis.where is not None else ""
    ordered = sorted(diagnosis.force, key=lambda missing: missing.trial != densest)
    return [(missing.trial, force_figure(missing)) for missing in ordered]


def errors(diagnosis: DiagnosisData) -> list[tuple[str, float, float]]:
    """Return rows of held-out nRMSE: channel (or all of them), of the nominal and of the extended model."""
    gain = diagnosis.gain
    if gain is None:
        return []
    return [(channel_name(name), gain.nominal[name], gain.extended[name]) for name in gain.nominal]


def shares(diagnosis: DiagnosisData) -> list[tuple[str, str, dict[str, float]]]:
    """Return where the misfit sits: title of each group, where it is densest, and all shares of it in order."""
    where = diagnosis.where
    if where is None:
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
    width = max(high - low, 1e-300)

    def place(value: float) -> float:
        return round(6.0 + 88.0 * min(max((value - low) / width, 0.0), 1.0), 2)

    return [{"at": place(e.estimate), "low": place(e.low), "high": place(e.high)} for e in estimates]
