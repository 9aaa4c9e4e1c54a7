"""The force that the nominal model lacks, over time, with its band."""

from __future__ import annotations

from typing import Any

from mjfish.diagnosis import Diagnosis
from mjfish.reporting.html import figure

_HEADINGS = ("along [N]", "across [N]", "moment at the nose [N m]")
_GAP = 0.07


def force_figure(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Return the missing force of the trial where the misfit is densest; None where nothing is wrong.

    One panel a component, bands two standard deviations wide on each side.
    """
    if diagnosis.where is None:
        return None
    chosen = next(one for one in diagnosis.force if one.trial == diagnosis.where.trial)
    data = []
    for k in range(len(_HEADINGS)):
        force, half = chosen.force[:, k], 2.0 * chosen.band[:, k]
        data.append(figure.band(chosen.time, force - half, force + half, "@nominal-soft", k + 1))
        data.append(figure.curve(chosen.time, force, "@nominal", k + 1))
    return {"data": data, "layout": _layout(float(chosen.time[0]), float(chosen.time[-1]))}


def force_shares(diagnosis: Diagnosis) -> list[tuple[str, list[str]]]:
    """Return, per trial, the share of the missing force in what moves the fish: along, across and in moment."""
    return [(one.trial, [f"{share:.1%}" for share in one.share]) for one in diagnosis.force]


def _layout(begin: float, end: float) -> dict[str, Any]:
    height = (1.0 - _GAP * (len(_HEADINGS) - 1)) / len(_HEADINGS)
    axes: dict[str, Any] = {}
    headings = []
    for k, title in enumerate(_HEADINGS):
        key, top = str(k + 1) if k else "", 1.0 - k * (height + _GAP)
        last = k == len(_HEADINGS) - 1
        axes[figure.named_axis("x", k + 1)] = figure.axis(
            (0.0, 1.0),
            f"y{key}",
            range=[begin, end],
            showticklabels=last,
            **({"title": figure.axis_title("time [s]")} if last else {}),
        )
        axes[figure.named_axis("y", k + 1)] = figure.axis(
            (max(top - height, 0.0), top), f"x{key}", zeroline=True, zerolinecolor="@muted", zerolinewidth=1, nticks=4
        )
        headings.append(figure.heading(title, k + 1))
    return figure.layout(380, axes, headings)
