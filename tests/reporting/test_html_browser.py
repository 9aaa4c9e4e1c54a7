"""Pages in a browser: nothing to complain of, nothing wider than the page, pickers and CSV that work."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest
from browser import look
from diagnosed import diagnosis, learned_diagnosis, splits

from mjfish.reporting.html.diagnosis import render_diagnosis
from mjfish.reporting.html.figures import profile_figure
from mjfish.reporting.html.misfit import beat_figure
from mjfish.reporting.html.pages import Block, Section, write_figures

#: Opens everything that is folded.
OPEN = "document.querySelectorAll('details').forEach((details) => { details.open = true; });"


@functools.cache
def _page(name: str) -> str:
    if name == "learned":
        return render_diagnosis(learned_diagnosis(), splits())
    return render_diagnosis(diagnosis(name))  # type: ignore[arg-type]


@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("name", ["named", "cannot_tell", "learned"])
def test_a_report_has_no_errors_and_nothing_wider_than_the_page(name: str, width: int) -> None:
    seen = look(_page(name), width, OPEN)
    assert seen.complaints == []
    assert seen.drawn > 3
    assert seen.page == seen.width == width
    assert seen.wide == []


def test_what_is_too_wide_or_fails_is_seen() -> None:
    """The probe itself: without it, a page that nobody could read would pass."""
    page = _page("named").replace("<main>", "<main><div style='width: 900px'>x</div><script>absent();</script>")
    seen = look(page, 400)
    assert seen.page > 400
    assert "DIV " in seen.wide
    assert any("absent is not defined" in complaint for complaint in seen.complaints)


def test_one_trial_is_shown_and_another_one_when_it_is_picked() -> None:
    choices = "[...document.querySelectorAll('#trial-figures > .choice')]"
    shown = f"{choices}.map((choice) => [choice.hidden, !!choice.querySelector('.main-svg')])"
    assert look(_page("named"), 1280, result=shown).result == [[False, True], [True, False]]
    pick = "const s = document.querySelector('select'); s.value = '1'; s.dispatchEvent(new Event('change'));"
    assert look(_page("named"), 1280, pick, shown).result == [[True, True], [False, True]]


def test_on_paper_every_trial_is_shown_and_on_the_screen_one_again() -> None:
    hidden = "[...document.querySelectorAll('.choice')].map((choice) => choice.hidden)"
    on_paper = look(_page("named"), 1280, "dispatchEvent(new Event('beforeprint'));", hidden)
    assert (on_paper.result, on_paper.complaints) == ([False] * 4, [])
    again = "dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint'));"
    assert look(_page("named"), 1280, again, hidden).result == [False, True, False, True]


def test_panels_stand_below_each_other_where_there_is_no_room_beside() -> None:
    panels = "[aria-label='mean residual over the phase of the beat'] .subplot .gridlayer"
    tops = f"""[...document.querySelectorAll("{panels}")].map((grid) => grid.getBoundingClientRect().top)"""
    wide, narrow = (look(_page("named"), width, result=tops).result for width in (1280, 400))
    assert len(wide) == len(narrow) == 3
    assert max(wide) - min(wide) < 20
    assert narrow[1] - narrow[0] > 150
    assert narrow[2] - narrow[1] > 150


def test_the_csv_of_a_figure_has_every_point_of_every_curve_and_band() -> None:
    label = "mean residual over the phase of the beat"
    rows = look(_page("named"), 1280, result=f"rowsOf(document.querySelector('[aria-label=\"{label}\"]'))").result
    figure = beat_figure(diagnosis())
    assert rows[0] == ["panel", "curve", "x", "y"]
    points = {tuple(row[:3]): row[3] for row in rows[1:]}
    assert len(points) == len(rows) - 1 == sum(len(trace.x) for trace in figure.data)
    band, curve = figure.data[:2]
    for x, y in zip(curve.x, curve.y, strict=True):
        assert points["surge [m/s]", "nominal", x] == y
    half = len(band.x) // 2
    for x, y in zip(band.x[:half], band.y[:half], strict=True):
        assert points["surge [m/s]", "nominal band, lower end", x] == y
    for x, y in zip(band.x[half:], band.y[half:], strict=True):
        assert points["surge [m/s]", "nominal band, upper end", x] == y


def test_names_with_commas_and_quotes_stay_one_field_and_gaps_are_empty() -> None:
    fields = look(_page("named"), 1280, result="['a,b', 'say \"x\"', null, -1.5e-9].map(quoted)").result
    assert fields == ['"a,b"', '"say ""x"""', "", "-1.5e-9"]


def test_a_page_of_figures_has_no_errors(tmp_path: Path) -> None:
    write_figures(tmp_path / "a.html", Section("Alone", "", {}, (Block("a", "", profile_figure([])),)))
    seen = look((tmp_path / "a.html").read_text(encoding="utf-8"), 400, OPEN)
    assert (seen.complaints, seen.wide, seen.page) == ([], [], 400)


def test_a_diagnosis_without_held_out_trials_is_drawn() -> None:
    seen = look(render_diagnosis(diagnosis("unexplained", held_out=False)), 400, OPEN)
    assert (seen.complaints, seen.wide) == ([], [])
