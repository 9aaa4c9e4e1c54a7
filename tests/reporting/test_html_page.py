"""The structure of pages: places and links, tables, figures, what a reader without a mouse or without scripts gets."""

from __future__ import annotations

import functools
import itertools
import re
from dataclasses import replace
from pathlib import Path

import pytest
from diagnosed import diagnosis, learned_diagnosis, page, splits
from html_tree import Element, tree

from mjfish.reporting.html.diagnosis import render_diagnosis
from mjfish.reporting.html.figures import profile_figure
from mjfish.reporting.html.pages import Block, Section, render, write_figures
from mjfish.reporting.html.readings import PROFILE

PAGES = ("named", "nothing_wrong", "cannot_tell", "unexplained", "learned", "splits", "figures")


@functools.cache
def _page(name: str) -> Element:
    if name == "figures":
        sections = [Section(f"part {k}", "", {}, (Block("a", "b", profile_figure([])),), PROFILE) for k in range(2)]
        return tree(render("figures.html.j2", sections=sections, title="Fit", lead="all of it"))
    if name == "learned":
        return tree(render_diagnosis(learned_diagnosis()))
    if name == "splits":
        return tree(render_diagnosis(diagnosis(), splits()))
    return tree(page(name))  # type: ignore[arg-type]


over_pages = pytest.mark.parametrize("name", PAGES)


@over_pages
def test_places_are_unique_and_every_link_leads_to_one(name: str) -> None:
    page = _page(name)
    places = [element.attributes["id"] for element in page.everything() if "id" in element.attributes]
    assert len(places) == len(set(places))
    links = [link.attributes["href"] for link in page.every("a")]
    assert links
    assert {link.removeprefix("#") for link in links} <= set(places)


@over_pages
def test_the_contents_list_every_section_in_order_and_by_its_heading(name: str) -> None:
    page = _page(name)
    (contents,) = page.every("nav")
    listed = [(link.attributes["href"], link.text) for link in contents.every("a")]
    sections = [(f"#{section.attributes['id']}", next(section.every("h2")).text) for section in page.every("section")]
    assert listed == sections


@over_pages
def test_every_table_has_a_caption_and_every_heading_a_scope(name: str) -> None:
    tables = list(_page(name).every("table"))
    assert tables or name == "figures"
    for table in tables:
        first = next(child for child in table.children if isinstance(child, Element))
        assert first.tag == "caption"
        assert first.text
        for heading in table.every("th"):
            assert heading.attributes.get("scope") in {"col", "row", "colgroup"}, heading.text
            assert heading.text
        if "row" not in {heading.attributes["scope"] for heading in table.every("th")}:
            assert "splits" in table.attributes["class"]  # its rows have no name


@over_pages
def test_every_figure_says_how_to_read_it_and_gives_its_data(name: str) -> None:
    page = _page(name)
    figures = list(page.every("figure"))
    assert len(figures) == len(list(page.every("div", "figure")))
    labels = []
    for figure in figures:
        (drawing,) = figure.every("div", "figure")
        (reading,) = figure.every("details", "reading")
        assert [term.text for term in reading.every("dt")] == ["Shown", "Good", "Bad", "Do"]
        assert all(len(words.text) > 20 for words in reading.every("dd"))
        assert "open" not in reading.attributes
        (button,) = figure.every("button", "csv")
        assert button.attributes["aria-label"] == f"Data as CSV: {drawing.attributes['aria-label']}"
        labels.append(drawing.attributes["aria-label"])
    repeated = {label for label in labels if labels.count(label) > 1}
    assert name == "learned" or not repeated  # the picture of a learned form is that of its section


@over_pages
def test_a_page_without_scripts_says_what_is_missing(name: str) -> None:
    (words,) = _page(name).every("noscript")
    assert words.text.startswith("JavaScript is off. The figures")


@over_pages
def test_there_is_one_first_heading_and_no_level_is_left_out(name: str) -> None:
    levels = [int(element.tag[1]) for element in _page(name).everything() if re.fullmatch(r"h\d", element.tag)]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))


def test_every_trial_can_be_picked_and_so_can_its_missing_force() -> None:
    page = _page("named")
    pickers = {select.attributes["data-picks"]: select for select in page.every("select")}
    assert list(pickers) == ["trial-figures", "force-figures"]
    for place, select in pickers.items():
        (choices,) = (element for element in page.everything() if element.attributes.get("id") == place)
        shown = [next(choice.every("h3")).text for choice in choices.every("div", "choice")]
        options = [option.text.removesuffix(" (held out)") for option in select.every("option")]
        assert len(shown) == 2
        assert all(title.startswith(option) for title, option in zip(shown, options, strict=True))
        assert select.inside("label")
    assert [option.text for option in pickers["trial-figures"].every("option")] == ["fast (held out)", "slow"]


def test_what_is_ruled_out_is_folded_and_what_is_named_is_not() -> None:
    (section,) = (s for s in _page("named").every("section") if s.attributes["id"] == "candidates")
    folded = {code.text: code.inside("details") for code in section.every("code")}
    assert folded == {"servo_lag": False, "time_offset": True, "tail_compliance": True, "ambient_current": True}
    assert all("open" not in details.attributes for details in section.every("details"))


def test_people_read_what_a_cause_does_before_the_name_that_the_code_has_for_it() -> None:
    page = _page("named")
    assert next(page.every("h1")).text == "The servos follow their command late"
    row = next(next(t for t in page.every("table", "candidates")).every("tbody"))
    assert next(row.every("th")).text == "The servos follow their command late servo_lag"


def test_what_to_do_next_stands_on_the_first_screen() -> None:
    def first(name: str) -> str:
        return next(_page(name).every("div", "next")).text

    assert "Confirm servo_lag: log the joint angles on the bench" in first("named")
    assert "mjfish simulate --fish extended.toml" in first("named")
    assert "Test time_offset: flash a light" in first("cannot_tell")
    assert "mjfish plan DATASET ranks runs by how far they set the rivals apart" in first("cannot_tell")
    assert "mjfish plan DATASET ranks runs by what they would show" in first("nothing_wrong")
    last = first("unexplained")
    assert "Test what comes closest, servo_lag: log the joint angles on the bench" in last
    assert last.index("comes closest") < last.index("mjfish diagnose DATASET --effects my_effects.py")


def test_the_first_picture_is_the_learned_curve_where_one_is_named() -> None:
    def first(name: str) -> str:
        return next(_page(name).every("div", "figure")).attributes["aria-label"]

    assert first("learned") == "Drag coefficient across, c_d: head, body and tail"
    assert "held-out trial fast" in first("named")


def test_a_page_of_one_section_has_no_contents(tmp_path: Path) -> None:
    write_figures(tmp_path / "a.html", Section("Alone", "", {}, (Block("a", "", profile_figure([])),)))
    page = tree((tmp_path / "a.html").read_text(encoding="utf-8"))
    assert not list(page.every("nav"))
    assert len(list(page.every("button", "csv"))) == 1


def test_names_of_users_do_not_break_the_structure() -> None:
    evil = '"></details></section><h1>x'
    found = diagnosis(names=(evil, "b"))
    page = tree(render_diagnosis(replace(found, dataset=replace(found.dataset, name=evil), message=evil)))
    assert len(list(page.every("h1"))) == 1
