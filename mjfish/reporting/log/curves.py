"""The curves of named mechanisms in a log: plots of y over x, drawn with lines in a view of the plane.

The viewer's own plots have time at their axis, and its views of the plane have one scale for both axes. So a curve is
drawn in a frame of fixed size, and labels tell the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import number, unit
from mjfish.reporting.curves import logarithmic, span, stretches

#: Width and height of the frame of a curve, and the room around it for labels.
FRAME = (160.0, 100.0)
_ROOM = 26.0
#: Labels of x nearer than this share of the width are in each other's way.
_APART = 0.15
#: Labels of y.
_LABELS = 4
_SEEN, _BEYOND = (46, 168, 178, 255), (130, 136, 145, 255)
_NOMINAL, _FAINT, _INK = (229, 138, 60, 255), (70, 78, 90, 255), (225, 228, 232, 255)
#: From a point of the frame to where its label stands, and half the length of a mark.
_ASIDE, _MARK = 13.0, 2.0


def form_tab(mechanisms: Sequence[NamedMechanism]) -> rrb.Vertical | None:
    """Return the views of the curves, a plot each below what is said of the mechanisms; None where there are none."""
    views = [_view(_root(mechanism, curve), curve) for mechanism in mechanisms for curve in mechanism.curves]
    said = rrb.TextDocumentView(origin="/curves/about", name="Mechanisms")
    return rrb.Vertical(said, rrb.Grid(*views), row_shares=[1, 4], name="Form") if views else None


def log_curves(recording: rr.RecordingStream, mechanisms: Sequence[NamedMechanism]) -> None:
    """Log every curve as ``/curves/MECHANISM/QUANTITY-GROUP``, without a time, and ``/curves/about`` in words.

    Per curve: ``seen`` where runs have been and ``beyond``, each a line and the edges of its band in turn; ``nominal``;
    ``frame`` and ``labels``. Nothing is logged where there is no curve.
    """
    lines = []
    for mechanism in mechanisms:
        if mechanism.curves:
            lines.append(f"**{mechanism.told}.**\n\n" + "\n".join(f"- {c.summary()}" for c in mechanism.curves))
        for curve in mechanism.curves:
            _log(recording, _root(mechanism, curve), curve)
    if lines:
        lines.append("Nominal model orange, fitted form teal with its 95 % band, grey where no run has been.")
        said = rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)
        recording.log("curves/about", said, static=True)


def placed_in_frame(curve: MeasuredCurve, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return where points x, y (n,) of a curve lie in its frame (n, 2), y downwards; what is outside is on its edge."""
    scale = np.log if logarithmic(curve) else np.asarray
    left, right = scale(np.array([curve.x.values[0], curve.x.values[-1]]))
    low, high = span(curve)
    across, up = (scale(np.asarray(x)) - left) / (right - left), (np.asarray(y) - low) / (high - low)
    width, height = FRAME
    return np.column_stack([width * np.clip(across, 0.0, 1.0), height * (1.0 - np.clip(up, 0.0, 1.0))])


def _root(mechanism: NamedMechanism, curve: MeasuredCurve) -> str:
    return "/curves/" + "/".join(map(rr.escape_entity_path_part, (mechanism.name, f"{curve.quantity}-{curve.group}")))


def _view(root: str, curve: MeasuredCurve) -> rrb.Spatial2DView:
    shown, (width, height) = unit(curve.y.unit), FRAME
    name = f"{curve.quantity} of {curve.group}{f' [{shown}]' if shown else ''}"
    return rrb.Spatial2DView(
        origin=root,
        name=f"{name} over {curve.x.name.replace('_', ' ')} [{curve.x.unit}]",
        background=rrb.Background(color=[22, 25, 30]),
        visual_bounds=rrb.VisualBounds2D(x_range=[-_ROOM, width + _ROOM], y_range=[-_ROOM, height + _ROOM]),
    )


def _log(recording: rr.RecordingStream, root: str, curve: MeasuredCurve) -> None:
    width, height = FRAME
    box = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height], [0.0, 0.0]]
    told, below, left = _labelled(curve)
    upright, level = np.array([[0.0, -_MARK], [0.0, _MARK]]), np.array([[-_MARK, 0.0], [_MARK, 0.0]])
    marks = [*(point + upright for point in below), *(point + level for point in left)]
    recording.log(f"{root}/frame", _lines([np.array(box), *marks], _FAINT, (0.6,)), static=True)
    labels = rr.Points2D(  # the viewer writes them below their points
        np.concatenate([below, left - [_ASIDE, 0.5 * _ASIDE]]),
        labels=told,
        show_labels=True,
        colors=[_INK],
        radii=rr.Radius.ui_points(0.1),
    )
    recording.log(f"{root}/labels", labels, static=True)
    nominal = placed_in_frame(curve, np.array(curve.x.values), np.array(curve.nominal))
    recording.log(f"{root}/nominal", _lines([nominal], _NOMINAL, (1.2,)), static=True)
    for name, seen, colour in (("beyond", False, _BEYOND), ("seen", True, _SEEN)):
        strips = [
            placed_in_frame(curve, piece.x, y)
            for piece in stretches(curve)
            if piece.seen == seen
            for y in (piece.y, piece.low, piece.high)
        ]
        if strips:
            radii = (2.0 if seen else 1.2, 0.6, 0.6) * (len(strips) // 3)
            recording.log(f"{root}/{name}", _lines(strips, colour, radii), static=True)


def _lines(strips: Sequence[FloatArray], colour: tuple[int, int, int, int], radii: Sequence[float]) -> rr.LineStrips2D:
    return rr.LineStrips2D(strips, colors=[colour], radii=rr.Radius.ui_points(np.array(radii)))


def _labelled(curve: MeasuredCurve) -> tuple[list[str], FloatArray, FloatArray]:
    """Return labels of x and y, and where those of x (n, 2) and y (m, 2) stand on the lower and left side of the frame.

    They are the ends of the visited range and of the curve, and round numbers.
    """
    seen, first, (low, high) = list(curve.seen or ()), curve.x.values[0], span(curve)
    x = np.array([*seen, *(end for end in (first, curve.x.values[-1]) if not _near(curve, end, seen))])
    y = _rounded(low, high)
    below = placed_in_frame(curve, x, np.full(len(x), low))
    return [number(value, 2) for value in (*x, *y)], below, placed_in_frame(curve, np.full(len(y), first), y)


def _near(curve: MeasuredCurve, x: float, others: Sequence[float]) -> bool:
    at = placed_in_frame(curve, np.array([x, *others]), np.zeros(1 + len(others)))[:, 0]
    return bool(np.any(np.abs(at[1:] - at[0]) < _APART * FRAME[0]))


def _rounded(low: float, high: float) -> FloatArray:
    """Return some round numbers from low to high, at most _LABELS + 1."""
    rough = (high - low) / _LABELS
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough)
    return np.asarray(step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) + 0.0)  # no minus zero
