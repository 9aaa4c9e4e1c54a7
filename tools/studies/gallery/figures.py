"""Pictures of a cause: what it changes in a swim, and its form as a curve."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from mjfish.diagnosis.curves import MeasuredCurve
from studies.gallery.swims import Swim

#: Beats at the end of a run that are drawn.
_BEATS = 2.0
_CHANNELS = (("surge", "m/s"), ("sway", "m/s"), ("yaw rate", "rad/s"))
_NOMINAL, _CAUSE = "#767676", "#0b61a4"
#: A picture of the same content has the same bytes, and its text is text.
_STYLE = {"svg.hashsalt": "mjfish", "svg.fonttype": "none", "axes.spines.top": False, "axes.spines.right": False}


def signature(swim: Swim) -> str:
    """Return the picture (SVG) of the velocities with and without a cause, and of their difference."""
    trial = swim.trial
    omega = trial.drive[-1].omega
    shown = trial.time >= trial.time[-1] - _BEATS * 2.0 * np.pi / omega
    phase = (trial.time[shown] - trial.time[shown][0]) * omega / (2.0 * np.pi)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        axes = figure.subplots(2, 3, sharex=True)
        for column, (name, unit) in enumerate(_CHANNELS):
            above, below = axes[:, column]
            above.plot(phase, swim.nominal[shown, column], color=_NOMINAL, label="nominal")
            above.plot(phase, swim.changed[shown, column], color=_CAUSE, label="with the cause")
            above.set_title(f"{name} [{unit}]", fontsize=10)
            below.axhline(0.0, color="#cccccc", linewidth=0.8)
            below.plot(phase, (swim.changed - swim.nominal)[shown, column], color=_CAUSE)
            below.set_xlabel("beat")
        axes[0, 0].legend(fontsize=8, frameon=False)
        axes[1, 0].set_ylabel("difference")
        return _svg(figure)


def forms(curves: Sequence[MeasuredCurve]) -> str:
    """Return the picture (SVG) of one curve a quantity: that which departs most from the nominal model."""
    chosen: dict[str, MeasuredCurve] = {}
    for curve in curves:
        if curve.quantity not in chosen or _departure(curve) > _departure(chosen[curve.quantity]):
            chosen[curve.quantity] = curve
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(4.5 * len(chosen), 2.8), layout="constrained")
        for axes, curve in zip(figure.subplots(1, len(chosen), squeeze=False)[0], chosen.values(), strict=True):
            x = curve.x.values
            if curve.seen:
                axes.axvspan(*curve.seen, color="#f0f0f0", zorder=0)
            axes.plot(x, curve.nominal, color=_NOMINAL, label="nominal")
            axes.plot(x, curve.y.values, color=_CAUSE, label="with the cause")
            axes.set_xlabel(f"{curve.x.name.replace('_', ' ')} [{curve.x.unit}]")
            axes.set_title(f"{curve.quantity} of the {curve.group} [{curve.y.unit}]", fontsize=10)
            axes.legend(fontsize=8, frameon=False)
        return _svg(figure)


def _departure(curve: MeasuredCurve) -> float:
    """Return how far a curve is from the nominal model where the runs have been, over the size of both."""
    low, high = curve.seen or (-np.inf, np.inf)
    x, y, nominal = (np.array(values) for values in (curve.x.values, curve.y.values, curve.nominal))
    seen = (x >= low) & (x <= high)
    return float(np.max(np.abs(y - nominal)[seen], initial=0.0) / max(np.max(np.abs(nominal)), 1e-12))


def _svg(figure: Figure) -> str:
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()
