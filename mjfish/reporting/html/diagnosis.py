"""The page of a diagnosis: what its templates show, section by section."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mjfish.diagnosis import Diagnosis, Estimate
from mjfish.diagnosis.discrepancy import FIFTHS
from mjfish.diagnosis.select import GOODNESS, KEEP
from mjfish.files import write_text
from mjfish.frames import CHANNELS
from mjfish.reporting.html.candidates import detectable, remark
from mjfish.reporting.html.figures import beat_figure, force_figure, overlay_figure
from mjfish.reporting.html.pages import render
from mjfish.reporting.words import CHANNEL_NAMES, VERDICTS

_PARTS = ("start-up", "transition", "steady")


def write_diagnosis(diagnosis: Diagnosis, path: Path) -> None:
    """Write the page of a diagnosis as one HTML file, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render_diagnosis(diagnosis))


def render_diagnosis(diagnosis: Diagnosis) -> str:
    """Return the page of a diagnosis as HTML: self-contained, everything that came from a user escaped."""
    overlays = sorted(diagnosis.overlays, key=lambda overlay: not overlay.held_out)
    declared = {p.name: p for p in (*diagnosis.nominal_model.parameters, *diagnosis.extended_model.parameters)}
    possible = [cause.name for cause in diagnosis.causes] or [name for group in diagnosis.rivals for name in group]
    return render(
        "diagnosis.html.j2",
        diagnosis=diagnosis,
        badge=VERDICTS[diagnosis.verdict],
        sampled=sum(len(overlay.trial.time) for overlay in diagnosis.overlays),
        errors=errors(diagnosis),
        channel_names=CHANNEL_NAMES,
        trials=[(overlay, overlay_figure(diagnosis, overlay)) for overlay in overlays],
        beat=beat_figure(diagnosis),
        where=shares(diagnosis),
        force=force_figure(diagnosis),
        effects=diagnosis.effects,
        chosen={*diagnosis.certain, *(name for group in diagnosis.rivals for name in group)},
        remark=lambda candidate: remark(candidate, diagnosis),
        detectable=lambda candidate: detectable(candidate, diagnosis),
        keep=KEEP,
        goodness=GOODNESS,
        experiments=[diagnosis.effects[name] for name in possible if name in diagnosis.effects],
        declared=declared,
        names=[*diagnosis.nominal, *(name for name in diagnosis.extended if name not in diagnosis.nominal)],
        whiskers=whiskers,
    )


def errors(diagnosis: Diagnosis) -> list[tuple[str, float, float]]:
    """Return rows of held-out nRMSE: channel (or all of them), of the nominal and of the extended model."""
    gain = diagnosis.gain
    if gain is None:
        return []
    return [(CHANNEL_NAMES[name], gain.nominal[name], gain.extended[name]) for name in (*CHANNELS, "pooled")]


def shares(diagnosis: Diagnosis) -> list[tuple[str, str, dict[str, float]]]:
    """Return where the misfit sits: title of each group, where it is densest, and all shares of it in order."""
    where = diagnosis.where
    if where is None:
        return []
    trials = [trial.name for trial in diagnosis.dataset.trials]
    named = {CHANNEL_NAMES[name]: share for name, share in where.channels.items()}
    return [
        ("channel", CHANNEL_NAMES[where.channel], _in_order(named, CHANNEL_NAMES.values())),
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
