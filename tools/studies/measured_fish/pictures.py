"""Pictures of docs/real-fish.md, as SVG: the held-out run, the residual over the beat, and what the roll explains."""

from __future__ import annotations

import numpy as np

from mjfish.diagnosis import Overlay
from mjfish.drive.measured import smoothing_spline
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray
from picture import PANELS, Frame, axes, dots, line, page, span_of, title
from studies.measured_fish.runs import MODELS, Outcome, phases, residual

#: Bins of a beat, and the length of a run that is drawn [s].
BINS, LENGTH = 16, 5.0
_SWAY, _YAW_RATE = CHANNELS.index("sway"), CHANNELS.index("yaw_rate")


def swum(outcome: Outcome) -> str:
    """Return yaw rate and sway of the held-out run: measured, and by both models."""
    overlay = _shown(outcome)
    time = overlay.trial.time
    part = time <= time[0] + LENGTH
    lines: list[str] = []
    for panel, channel in zip(PANELS, (_YAW_RATE, _SWAY), strict=True):
        measured = overlay.trial.velocity[part, channel]
        before, after = ((measured - residual(outcome.diagnosis, overlay, who)[part, channel]) for who in MODELS)
        frame = Frame((float(time[0]), float(time[part][-1])), span_of(measured, before, after), *panel)
        lines += axes(frame, _label(channel), numbered=panel is PANELS[-1])
        lines += [line(frame, time[part], before, "before"), line(frame, time[part], after, "after")]
        lines.append(dots(frame, time[part], measured))
    legend = {"measured": "measured", "before": "nominal", "after": _after(outcome)}
    return page(title(_heading(overlay), legend), lines, "Yaw rate and sway of a run, measured and simulated")


def over_the_beat(outcome: Outcome) -> str:
    """Return the mean residual of sway and yaw rate of the held-out run over the beat."""
    overlay = _shown(outcome)
    means = phases(outcome, overlay, BINS)
    centre = (np.arange(BINS) + 0.5) / BINS
    lines: list[str] = []
    for panel, channel in zip(PANELS, (_YAW_RATE, _SWAY), strict=True):
        before, after = means["nominal"][:, channel], means["extended"][:, channel]
        frame = Frame((0.0, 1.0), span_of(before, after, np.zeros(1)), *panel)
        lines += axes(
            frame, f"measured − simulated: {_label(channel)}", numbered=panel is PANELS[-1], below="phase [beats]"
        )
        lines += [line(frame, centre, before, "before"), line(frame, centre, after, "after")]
    legend = {"before": "nominal", "after": _after(outcome)}
    return page(title(_heading(overlay), legend), lines, "Residual of yaw rate and sway over the beat")


def rolled(outcome: Outcome) -> str:
    """Return the sway that the nominal model lacks in the fitted runs, and what the measured roll makes.

    Measured: sway of the head's markers less that of the nominal model, less its mean; curve: -height times the
    measured rate of roll.
    """
    height = outcome.diagnosis.extended["roll.height"].estimate
    lines: list[str] = []
    fitted = [one for one in outcome.diagnosis.overlays if not one.held_out][: len(PANELS)]
    for panel, overlay in zip(PANELS, fitted, strict=False):
        time = overlay.trial.time
        part = time <= time[0] + LENGTH
        left, wobble = lacking(outcome, overlay, height)
        frame = Frame((float(time[0]), float(time[part][-1])), span_of(left[part], wobble[part]), *panel)
        lines += axes(frame, f"{overlay.trial.name}: {_label(_SWAY)}", numbered=panel is PANELS[-1])
        lines += [line(frame, time[part], wobble[part], "after"), dots(frame, time[part], left[part])]
    legend = {"measured": "measured less nominal", "after": "from the measured roll"}
    return page(title("Fitted runs", legend), lines, "Sway that the nominal model lacks, and measured roll")


def lacking(outcome: Outcome, overlay: Overlay, height: float) -> tuple[FloatArray, FloatArray]:
    """Return the sway (n,) [m/s] that the nominal model lacks, and that by the measured roll.

    The nominal fit knows of no roll, so that likeness of the two is none that the fit has made.
    """
    trial = overlay.trial
    assert trial.roll is not None  # noqa: S101 - the importer measures it
    wobble = -height * smoothing_spline(trial.time, trial.roll)(trial.time, nu=1)
    left = residual(outcome.diagnosis, overlay, "nominal")[:, _SWAY]
    return np.asarray(left - np.nanmean(left)), np.asarray(wobble)


def _shown(outcome: Outcome) -> Overlay:
    """Return the first held-out run, else the last one."""
    overlays = outcome.diagnosis.overlays
    return next((overlay for overlay in overlays if overlay.held_out), overlays[-1])


def _heading(overlay: Overlay) -> str:
    return f"{'Held-out' if overlay.held_out else 'Fitted'} run {overlay.trial.name}"


def _after(outcome: Outcome) -> str:
    return f"with {' and '.join(outcome.diagnosis.best) or 'no cause'}"


def _label(channel: int) -> str:
    return f"{CHANNELS[channel].replace('_', ' ')} [{UNITS[CHANNELS[channel]]}]"
