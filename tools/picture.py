"""Draw the picture of the README: a held-out trial as measured and as simulated before and after, and what is left.

    python tools/picture.py mjfish/demo --out docs/images/before-after.svg

The picture is plain SVG text, so that a new one shows in a diff what moved.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from mjfish.data import load_dataset
from mjfish.diagnosis import Diagnosis, Overlay, diagnose
from mjfish.files.writing import write_text
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.html.figures import scored_predictions

WIDTH, HEIGHT = 880, 470
#: Left and right edge of both panels; top and bottom of each [px].
LEFT, RIGHT = 62, 860
PANELS = ((64, 284), (326, 424))
#: Longest stretch that is drawn [s].
STRETCH = 3.0
#: A stretch that begins this soon after the trial does begins with it [s].
_SOON = 0.3
INK, MUTED, GRID = "#1d2126", "#6a727c", "#e6e8ea"
COLOURS = {"measured": "#454c54", "before": "#d9772b", "after": "#13808c"}


@dataclass(frozen=True)
class Frame:
    """A panel: data ranges and pixel ranges of both axes."""

    x: tuple[float, float]
    y: tuple[float, float]
    top: int
    bottom: int

    def across(self, value: float) -> float:
        """Return the pixel of a time."""
        return LEFT + (RIGHT - LEFT) * (value - self.x[0]) / (self.x[1] - self.x[0])

    def down(self, value: float) -> float:
        """Return the pixel of a value."""
        return self.bottom - (self.bottom - self.top) * (value - self.y[0]) / (self.y[1] - self.y[0])


def picture(diagnosis: Diagnosis) -> str:
    """Return the picture of a diagnosis as SVG; of the held-out trial and stretch where the nominal model is worst."""
    channel = CHANNELS.index(diagnosis.where.channel) if diagnosis.where else 0
    overlays = [one for one in diagnosis.overlays if one.held_out] or list(diagnosis.overlays)
    overlays = [replace(one, **scored_predictions(diagnosis, one)) for one in overlays]
    overlay = max(overlays, key=lambda one: float(np.nanmean((one.trial.velocity - one.nominal)[:, channel] ** 2)))
    part = _stretch(overlay, channel)
    time = overlay.trial.time[part]
    measured, before, after = (
        values[part, channel] for values in (overlay.trial.velocity, overlay.nominal, overlay.extended)
    )
    span = (float(time[0]), float(time[-1]))
    upper = Frame(span, span_of(measured, before, after), *PANELS[0])
    lower = Frame(span, span_of(measured - before, measured - after), *PANELS[1])
    name, unit = CHANNELS[channel].replace("_", " "), UNITS[CHANNELS[channel]]
    lines = [
        *axes(upper, f"{name} [{unit}]", numbered=False),
        line(upper, time, before, "before"),
        line(upper, time, after, "after"),
        dots(upper, time, measured),
        *axes(lower, f"measured − simulated [{unit}]", numbered=True),
        line(lower, time, measured - before, "before"),
        line(lower, time, measured - after, "after"),
    ]
    return page(_title(diagnosis, overlay), lines)


def _stretch(overlay: Overlay, channel: int) -> slice:
    """Return the stretch over which the nominal model is worst."""
    time = overlay.trial.time
    count = int(np.searchsorted(time, time[0] + STRETCH)) + 1
    if count >= len(time):
        return slice(None)
    energy = np.concatenate([[0.0], np.nancumsum((overlay.trial.velocity - overlay.nominal)[:, channel] ** 2)])
    first = int(np.argmax(energy[count:] - energy[:-count]))
    first = first if time[first] - time[0] > _SOON else 0
    return slice(first, first + count)


def span_of(*curves: FloatArray) -> tuple[float, float]:
    """Return the range of curves with a margin."""
    low, high = min(float(np.nanmin(c)) for c in curves), max(float(np.nanmax(c)) for c in curves)
    margin = 0.06 * (high - low)
    return low - margin, high + margin


def _ticks(low: float, high: float, count: int) -> FloatArray:
    """Return round numbers between two ends, about `count` of them."""
    raw = (high - low) / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min((m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw), default=10.0)
    return np.asarray(step * np.arange(np.ceil(low / step), np.floor(high / step) + 1) + 0.0)  # no minus zero


def axes(frame: Frame, label: str, *, numbered: bool, below: str = "time [s]") -> list[str]:
    """Return grid and numbers of a panel."""
    lines = [text(LEFT, frame.top - 9, label, fill=MUTED)]
    for value in _ticks(*frame.y, 4):
        y = frame.down(value)
        lines.append(f'<path d="M{LEFT} {y:.1f}H{RIGHT}" stroke="{GRID}"/>')
        lines.append(text(LEFT - 8, y + 4, f"{value:g}".replace("-", "−"), anchor="end", fill=MUTED))
    for value in _ticks(*frame.x, 8):
        x = frame.across(value)
        lines.append(f'<path d="M{x:.1f} {frame.top}V{frame.bottom}" stroke="{GRID}"/>')
        if numbered:
            lines.append(text(x, frame.bottom + 18, f"{value:g}", anchor="middle", fill=MUTED))
    if numbered:
        lines.append(text(RIGHT, frame.bottom + 36, below, anchor="end", fill=MUTED))
    return lines


def line(frame: Frame, time: FloatArray, values: FloatArray, who: str) -> str:
    """Return a curve in the colour of `who`; NaN are left out."""
    drawn = np.isfinite(values)
    pairs = zip(time[drawn], values[drawn], strict=True)
    points = " ".join(f"{frame.across(t):.1f},{frame.down(v):.1f}" for t, v in pairs)
    style = f'fill="none" stroke="{COLOURS[who]}" stroke-width="1.6" stroke-linejoin="round"'
    return f'<polyline class="{who}" {style} points="{points}"/>'


def dots(frame: Frame, time: FloatArray, values: FloatArray) -> str:
    """Return dots: strokes without length, with round ends."""
    pairs = ((t, v) for t, v in zip(time, values, strict=True) if np.isfinite(v))
    path = "".join(f"M{frame.across(t):.1f} {frame.down(v):.1f}h0" for t, v in pairs)
    colour = COLOURS["measured"]
    return f'<path class="measured" d="{path}" stroke="{colour}" stroke-width="3.8" stroke-linecap="round"/>'


def _title(diagnosis: Diagnosis, overlay: Overlay) -> list[str]:
    """Return the heading: whose run it is, and the legend."""
    what = "Held-out run" if overlay.held_out else "Fitted run"
    after = f"with {' and '.join(diagnosis.best) or 'no cause'}"
    return title(f"{what} {overlay.trial.name}", {"measured": "measured", "before": "nominal model", "after": after})


def title(heading: str, legend: Mapping[str, str]) -> list[str]:
    """Return a heading with a legend: what each colour stands for."""
    lines = [text(LEFT, 28, heading, fill=INK, weight="600", size=15)]
    x = float(RIGHT)
    for who, words in reversed(legend.items()):
        x -= 7.0 * len(words)
        lines.append(text(x, 28, words, fill=MUTED))
        lines.append(f'<path d="M{x - 26:.1f} 24h18" stroke="{COLOURS[who]}" stroke-width="4" stroke-linecap="round"/>')
        x -= 48.0
    return lines


def text(
    x: float, y: float, words: str, *, fill: str, anchor: str = "start", weight: str = "400", size: int = 13
) -> str:
    """Return a piece of text."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{fill}" text-anchor="{anchor}" font-weight="{weight}" '
        f'font-size="{size}">{escape(words)}</text>'
    )


def page(
    heading: list[str],
    lines: list[str],
    about: str = "Measured against simulated, before and after, and the residuals",
) -> str:
    """Return the picture; `about` says what it shows."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="system-ui, -apple-system, Segoe UI, Roboto, sans-serif" role="img" '
        f'aria-label="{escape(about)}">'
    )
    card = f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" fill="#ffffff" stroke="{GRID}"/>'
    return "\n".join([head, card, *heading, *lines, "</svg>", ""])


def main() -> None:
    """Diagnose a dataset and draw it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("dataset", type=Path, help="folder with dataset.toml")
    parser.add_argument("--out", type=Path, default=Path("docs/images/before-after.svg"), help="file to write")
    given = parser.parse_args()
    write_text(given.out, picture(diagnose(load_dataset(given.dataset))))


if __name__ == "__main__":
    main()
