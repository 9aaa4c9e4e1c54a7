"""The picture of a learned form shows the curve as measured, its band, the planted truth and the nominal model."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from diagnosed import VISITED, drag_curve

import curve_picture

_SVG = "{http://www.w3.org/2000/svg}"


def _points(svg: str, kind: str, who: str) -> np.ndarray:
    root = ET.fromstring(svg)  # noqa: S314 - our own text
    (found,) = (each for each in root.iter(f"{_SVG}{kind}") if each.get("class") == who)
    return np.array([point.split(",") for point in (found.get("points") or "").split()], dtype=float)


def test_all_curves_are_drawn_over_what_was_visited_and_to_one_scale() -> None:
    curve = drag_curve()
    svg = curve_picture.picture(curve, lambda x: 1.3 * x**-0.2)
    learned, planted, nominal = (_points(svg, "polyline", who) for who in ("after", "measured", "before"))
    at = np.linspace(*VISITED, len(learned))
    values = {
        "learned": np.array([curve.at(float(x))[0] for x in at]),
        "planted": 1.3 * at**-0.2,
        "nominal": 0.0 * at + 2.0,
    }
    drawn = np.concatenate([learned, planted, nominal])[:, 1]
    slope, level = np.polyfit(np.concatenate([*values.values()]), drawn, 1)
    assert slope < 0.0  # pixels count downwards
    np.testing.assert_allclose(drawn, level + slope * np.concatenate([*values.values()]), atol=0.1)
    band = _points(svg, "polygon", "band")
    edges = np.array([curve.at(float(x))[1:] for x in at])
    np.testing.assert_allclose(band[:, 1], level + slope * np.concatenate([edges[:, 0], edges[::-1, 1]]), atol=0.1)
    np.testing.assert_allclose(learned[:, 0], np.interp(at, VISITED, (62, 860)), atol=0.1)
    for words in ("learned", "planted", "nominal model", "speed [m/s]"):
        assert words in svg
