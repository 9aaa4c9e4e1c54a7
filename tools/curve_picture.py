"""Draw the learned form of the README: a measured curve with its band, the planted truth, and the nominal model.

    python tools/curve_picture.py --out docs/images/learned-form.svg

It is that of `mjfish demo --learned`. The picture is plain SVG text, as that of `tools/picture.py`.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np

from make_demo import FOLDER, coefficient
from mjfish.data import load_dataset
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.files.writing import write_text
from mjfish.numerics.arrays import FloatArray
from picture import COLOURS, Frame, axes, line, page, span_of, title

#: What is drawn, and top and bottom of the panel [px].
QUANTITY, GROUP = "c_d", "body"
PANEL = (64, 424)


def picture(curve: MeasuredCurve, truth: Callable[[FloatArray], FloatArray]) -> str:
    """Return the picture of a curve as SVG, over the range in which the runs say something of it.

    Args:
        curve: measured.
        truth: the planted values (n,) at x (n,).
    """
    low, high = curve.seen or (curve.x.values[0], curve.x.values[-1])
    at = np.linspace(low, high, 121)
    y, below, above = np.array([curve.at(float(speed)) for speed in at]).T
    planted, nominal = truth(at), np.interp(at, curve.x.values, curve.nominal)
    bottom, top = span_of(below, above, planted, nominal)
    frame = Frame((low, high), (max(bottom, 0.0), top), *PANEL)
    name = f"{curve.quantity} of the {curve.group}"
    legend = {"after": "learned, 95 % band", "measured": "planted", "before": "nominal model"}
    lines = [
        *axes(frame, f"{curve.quantity} [{curve.y.unit}]", numbered=True, below=f"{curve.x.name} [{curve.x.unit}]"),
        _band(frame, at, below, above),
        line(frame, at, nominal, "before"),
        line(frame, at, y, "after"),
        _dashed(line(frame, at, planted, "measured")),
    ]
    return page(title(f"Drag law: {name}", legend), lines, "A learned curve with its band, and the planted one")


def _band(frame: Frame, x: FloatArray, low: FloatArray, high: FloatArray) -> str:
    """Return the band between two curves."""
    corners = [*zip(x, low, strict=True), *zip(x[::-1], high[::-1], strict=True)]
    points = " ".join(f"{frame.across(a):.1f},{frame.down(b):.1f}" for a, b in corners)
    return f'<polygon class="band" fill="{COLOURS["after"]}" fill-opacity="0.2" points="{points}"/>'


def _dashed(drawn: str) -> str:
    """Return a curve in dashes: it lies on another one."""
    return drawn.replace("/>", ' stroke-dasharray="6 5"/>')


def main() -> None:
    """Diagnose the demo of a learned form and draw a curve of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/learned-form.svg"), help="file to write")
    given = parser.parse_args()
    (mechanism,) = diagnose(load_dataset(FOLDER / "learned")).mechanisms
    curve = next(each for each in mechanism.curves if (each.quantity, each.group) == (QUANTITY, GROUP))
    write_text(given.out, picture(curve, functools.partial(coefficient, f"{QUANTITY}.{GROUP}")))


if __name__ == "__main__":
    main()
