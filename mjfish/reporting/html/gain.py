"""What knowing the cause gains on trials that nothing was fitted to."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.diagnosis import Diagnosis
from mjfish.frames import CHANNELS
from mjfish.reporting.html.words import CHANNEL_NAMES, number, percent


@dataclass(frozen=True)
class ErrorRow:
    """One line of the table of held-out errors; `before` and `after` in percent of the longest bar for drawing."""

    name: str
    nominal: str
    extended: str
    reduction: str
    before: float
    after: float


@dataclass(frozen=True)
class GainView:
    """Held-out errors as a page shows them."""

    rows: tuple[ErrorRow, ...]
    reduction: str
    low: str
    high: str
    certain: bool
    trials: tuple[str, ...]


def gain_view(diagnosis: Diagnosis) -> GainView | None:
    """Return the gain on held-out trials, None where there is none to show."""
    gain = diagnosis.gain
    if gain is None:
        return None
    names = [*CHANNELS, "pooled"]
    longest = max(*gain.nominal.values(), *gain.extended.values(), 1e-12)
    rows = [
        ErrorRow(
            name=CHANNEL_NAMES.get(name, "all channels"),
            nominal=percent(gain.nominal[name]),
            extended=percent(gain.extended[name]),
            reduction=_reduction(gain.nominal[name], gain.extended[name]),
            before=100.0 * gain.nominal[name] / longest,
            after=100.0 * gain.extended[name] / longest,
        )
        for name in names
    ]
    before, after = gain.mean_speed_error
    slowest = max(before, after, 1e-12)
    rows.append(
        ErrorRow(
            name="mean speed",
            nominal=f"{number(before)} m/s",
            extended=f"{number(after)} m/s",
            reduction=_reduction(before, after),
            before=100.0 * before / slowest,
            after=100.0 * after / slowest,
        )
    )
    return GainView(
        rows=tuple(rows),
        reduction=percent(gain.relative_reduction, 2),
        low=percent(gain.low, 2),
        high=percent(gain.high, 2),
        certain=gain.low > 0.0,
        trials=tuple(overlay.trial.name for overlay in diagnosis.overlays if overlay.held_out),
    )


def _reduction(before: float, after: float) -> str:
    return percent(1.0 - after / before, 2) if before > 0.0 else "–"
