"""What of a run is shown: a stretch of it, at which speed, and where the fish begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.log.drawing import Drawing

#: Beats of a stretch that is shown slowly, and of one whose instants stand beside each other.
BEATS, BEATS_OF_STILL = 8, 14
#: A beat is slowed so far that it lasts this long [s].
_BEAT_LASTS = 0.7
#: Frequencies that count as beats [Hz].
_SLOWEST = 0.2


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a run.

    Attributes:
        drawing: the run, its fish moved to where they begin.
        start, end: of the stretch [s].
        slowdown: how many times slower than it was swum it is shown.
        anchored: whether simulated fish were moved onto the measured one at the start.
    """

    drawing: Drawing
    start: float
    end: float
    slowdown: int = 1
    anchored: bool = False


def whole(drawing: Drawing) -> Stretch:
    """Return all of a run, as fast as it was swum; simulated fish begin where the measured one does."""
    start, end = _ends(drawing)
    return _anchored(drawing, start, end, 1)


def steady(drawing: Drawing, count: int = BEATS) -> Stretch:
    """Return so many last beats of a run, slowed."""
    beat, (first, end) = beats(drawing), _ends(drawing)
    return _anchored(drawing, max(first, end - count * beat), end, _slowdown(beat))


def worst(drawing: Drawing, count: int = BEATS) -> Stretch:
    """Return so many beats over which the nominal fish goes furthest from the measured one, slowed.

    At the start of these the simulated fish are moved onto the measured one, place and heading: what is seen then is
    what goes wrong within them, not what has added up before.
    """
    beat, (first, last) = beats(drawing), _ends(drawing)
    starts = np.arange(first, max(last - count * beat, first) + 1e-9, max(beat, 0.1))
    choices = [_anchored(drawing, start, min(start + count * beat, last), _slowdown(beat)) for start in starts]
    return max(choices, key=_distance)


def beats(drawing: Drawing) -> float:
    """Return the time of one beat [s]: the strongest frequency of the angle between tail and head."""
    figure = drawing.figures[0]
    step = float(np.median(np.diff(figure.time)))
    even = figure.at(np.arange(figure.time[0], figure.time[-1], step))
    bend = np.unwrap(2.0 * np.arctan2(even.turn[:, -1, 2], even.turn[:, -1, 3])) - even.heading()
    power = np.abs(np.fft.rfft((bend - bend.mean()) * np.hanning(len(bend)), n=8 * len(bend))) ** 2
    frequency = np.fft.rfftfreq(8 * len(bend), step)
    power[frequency < _SLOWEST] = 0.0
    return float(1.0 / frequency[np.argmax(power)]) if power.max() > 0.0 else 1.0


def _slowdown(beat: float) -> int:
    return max(1, round(_BEAT_LASTS / beat))


def _ends(drawing: Drawing) -> tuple[float, float]:
    """Return the times between which there is every fish [s], or nearly: one that diverged ends earlier."""
    return float(drawing.figures[0].time[0]), max(float(figure.time[-1]) for figure in drawing.figures)


def _anchored(drawing: Drawing, start: float, end: float, slowdown: int) -> Stretch:
    first, *others = drawing.figures
    if first.swimmer != "measured":
        return Stretch(drawing, start, end, slowdown)
    moved = replace(drawing, figures=(first, *(figure.onto(first, start) for figure in others)))
    return Stretch(moved, start, end, slowdown, anchored=len(others) > 0)


def _distance(stretch: Stretch) -> float:
    """Return how far the nominal nose is from the measured one at the end [m]."""
    noses: dict[str, FloatArray] = {
        figure.swimmer: figure.at(np.array([stretch.end])).path[0] for figure in stretch.drawing.figures
    }
    if not {"measured", "nominal"} <= set(noses):
        return 0.0
    return float(np.linalg.norm(noses["nominal"] - noses["measured"]))
