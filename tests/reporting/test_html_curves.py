"""The forms in the report: every curve with its numbers, apart where no run has been."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import SPEEDS, VISITED, drag_curve, drag_law, learned_diagnosis, page

from mjfish.effects import find
from mjfish.reporting.curves import logarithmic, span, stretches
from mjfish.reporting.html.curves import curve_figure, form_rows
from mjfish.reporting.html.diagnosis import render_diagnosis


def _text(html: str) -> str:
    section = html[html.index("<h2>Form</h2>") : html.index("<h2>What the extended model gains</h2>")]
    section = re.sub(r"<script.*?</script>", "", section, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", section).split())


def test_the_page_tells_form_quantity_groups_and_where_the_runs_have_been() -> None:
    told = _text(render_diagnosis(learned_diagnosis()))
    assert "drag_law: these data do not settle its form: reynolds_drag or linear_drag." in told
    assert "Drag coefficient across, c_d: head, body and tail" in told
    assert "body 0.046 to 0.46 m/s" in told
    assert "head nowhere that says something of it; body 0.046 to 0.46 m/s" in told


@pytest.mark.parametrize(
    ("freedom", "visited", "bears"),
    [
        (None, VISITED, "curve"),
        (4.0, VISITED, "curve"),
        (1.4, VISITED, "number"),
        (4.0, (0.2, 0.29), "number"),
        (0.4, VISITED, "nothing"),
        (4.0, (0.0, 0.0), "nothing"),
    ],
)
def test_what_the_runs_bear_of_a_curve_is_said(freedom: float | None, visited: tuple[float, float], bears: str) -> None:
    """Two numbers make a curve: fewer are a constant, or nothing; so is one speed."""
    curve = drag_curve("c_d", "body", visited=visited, freedom=freedom)
    assert curve.bears == bears
    (row,) = form_rows([replace(drag_law(), curves=(curve,))])
    caption, summary = row[1][0].caption, curve.summary()
    assert ("one number, no curve" in caption, "one number" in summary) == (bears == "number", bears == "number")
    assert ("nowhere" in caption, "say nothing of it" in summary) == (bears == "nothing", bears == "nothing")


def test_without_curves_there_is_no_such_section() -> None:
    assert "<h2>Form</h2>" not in page()
    assert form_rows([replace(drag_law(), curves=())]) == []


def test_a_figure_a_quantity_and_a_panel_a_group() -> None:
    (row,) = form_rows([drag_law()])
    across, along = row[1]
    assert [note.text for note in across.figure.layout.annotations] == ["c_d, head", "c_d, body", "c_d, tail"]
    assert [note.text for note in along.figure.layout.annotations] == ["c_f, head", "c_f, body"]
    assert across.figure.layout.xaxis2.type == "log"
    assert across.figure.layout.xaxis2.title.text == "speed [m/s]"


def test_the_curve_is_solid_where_the_runs_have_been_and_dotted_elsewhere() -> None:
    curve = drag_curve()
    traces = curve_figure([curve]).data
    lines = [trace for trace in traces if trace.name]
    (solid,) = [trace for trace in lines if trace.name == "fitted form"]
    first, last = VISITED
    inside = (first <= SPEEDS) & (last >= SPEEDS)
    np.testing.assert_allclose(solid.x, SPEEDS[inside], rtol=1e-4)
    np.testing.assert_allclose(solid.y, np.array(curve.y.values)[inside], rtol=1e-4)
    dotted = [trace for trace in lines if trace.name == "where no run has been"]
    assert [trace.line.dash for trace in dotted] == ["dot", "dot"]
    assert sum(len(trace.x) for trace in dotted) == np.sum(~inside) + 2  # neighbours share an end
    (nominal,) = [trace for trace in lines if trace.name == "nominal model"]
    assert nominal.line.dash == "dash"
    np.testing.assert_allclose(nominal.y, curve.nominal)


def test_the_band_is_drawn_around_the_curve() -> None:
    curve = drag_curve()
    bands = [trace for trace in curve_figure([curve]).data if trace.fill == "toself"]
    pieces = stretches(curve)
    assert len(bands) == len(pieces) == 3
    for band, piece in zip(bands, pieces, strict=True):
        np.testing.assert_allclose(band.y, [*piece.low, *piece.high[::-1]], rtol=1e-4)
    drawn = {(x, y) for band in bands for x, y in zip(band.x, band.y, strict=True)}
    for ends in (curve.y.low, curve.y.high):
        assert {(float(f"{x:.5g}"), float(f"{y:.5g}")) for x, y in zip(SPEEDS, ends, strict=True)} <= drawn


def test_where_no_run_has_been_nothing_is_solid() -> None:
    names = {trace.name for trace in curve_figure([drag_curve(visited=(0.0, 0.0))]).data}
    assert names == {None, "nominal model", "where no run has been"}


def test_a_range_between_points_ends_between_them() -> None:
    below, inside, above = stretches(drag_curve(visited=(0.1001, 0.2002)))
    assert (inside.x[0], inside.x[-1]) == (0.1001, 0.2002) == (below.x[-1], above.x[0])
    assert [piece.seen for piece in (below, inside, above)] == [False, True, False]
    reaching = stretches(drag_curve(visited=(0.001, 2.0)))
    assert [(piece.seen, len(piece.x)) for piece in reaching] == [(True, len(SPEEDS))]


def test_the_scale_is_that_of_what_was_seen_and_of_the_nominal_model() -> None:
    curve = drag_curve()
    inside = next(piece for piece in stretches(curve) if piece.seen)
    low, high = span(curve)
    assert low < inside.low.min()
    assert high > inside.high.max()
    assert high - low == pytest.approx(1.7 * (inside.high.max() - inside.low.min()))
    far = replace(curve, nominal=(9.0,) * len(SPEEDS))
    assert span(far)[1] > 9.0
    flat = replace(curve, y=replace(curve.y, low=(1.0,) * 25, high=(1.0,) * 25), nominal=(1.0,) * 25)
    assert span(flat) == (0.0, 2.0)
    assert logarithmic(curve)
    assert not logarithmic(replace(curve, x=replace(curve.x, values=(0.0, *curve.x.values[1:]))))


def test_values_of_a_curve_are_no_reading() -> None:
    html = render_diagnosis(learned_diagnosis())
    assert "drag_law.whole" in html
    assert "across_1" not in html
    count = sum(not p.shape for p in find("drag_law").parameters)
    assert f"And {count} values of smooth curves, which diagnosis.json has." in html
    assert "smooth curves" not in page()
