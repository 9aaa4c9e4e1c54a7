"""Errors and warnings: the page says what the JSON file and the terminal say, all of it, in the same words."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from diagnosed import diagnosis
from html_tree import tree

from mjfish.cli.diagnosis_text import show
from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.next_steps import CAUTIONS
from mjfish.inspection import Finding, Inspection
from mjfish.reporting.html.diagnosis import render_diagnosis
from mjfish.reporting.titles import notices


def _warned() -> Diagnosis:
    """Return a diagnosis with a status, two findings, one with signs that HTML escapes, and two remarks."""
    blocks = Finding("clock-jump", "blocks", "v1 at 3 s", "a step of 0.4 s", "one < 0.02 s & steady", "cut there")
    suspect = Finding("outlier", "suspect", "v3", "9 <spikes>", "none", "look at the video")
    found = diagnosis()
    return replace(
        found,
        status="fit_not_converged",
        checks=Inspection((blocks, suspect)),
        remarks=(*found.remarks, 'the noise is "slow" & large'),
    )


def _on_page(found: Diagnosis) -> list[tuple[str, str]]:
    page = tree(render_diagnosis(found))
    return [
        (next(item.every("b")).text, next(item.every("span")).text)
        for part in page.every("ul", "notices")
        for item in part.every("li")
    ]


def _in_json(found: Diagnosis, path: Path) -> list[tuple[str, str]]:
    found.save(path)
    written = json.loads(path.read_text(encoding="utf-8"))
    status = (
        [] if written["status"] == "ok" else [("fit, status:", f"{written['status']}: {CAUTIONS[written['status']]}")]
    )
    data = [(f"data, {one['severity']}:", f"{one['code']}: {one['message']}") for one in written["checks"]["findings"]]
    return [*status, *data, *(("diagnosis, remark:", remark) for remark in written["remarks"])]


def _in_terminal(found: Diagnosis, capsys: pytest.CaptureFixture[str]) -> list[tuple[str, str]]:
    """Return what the long output says; a line that goes on is indented."""
    show(found, "DATASET", verbose=True)
    out, err = capsys.readouterr()
    status = [("fit, status:", line) for line in err.splitlines()]
    lines = re.sub(r"\n {11}", " ", out)
    data = re.findall(r"^(blocks|suspect) +([a-z-]+: .*)$", lines, re.MULTILINE)
    remarks = re.findall(r"^remark +(.*)$", lines, re.MULTILINE)
    return [
        *status,
        *((f"data, {severity}:", text) for severity, text in data),
        *(("diagnosis, remark:", text) for text in remarks),
    ]


def test_page_json_and_terminal_say_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for found, count in ((_warned(), 5), (diagnosis(), 1), (replace(diagnosis(), remarks=()), 0)):
        shown = _on_page(found)
        assert len(shown) == len(notices(found)) == count
        assert shown == _in_json(found, tmp_path / "a.json")
        assert shown == _in_terminal(found, capsys)


def test_the_first_screen_counts_them_and_leads_to_them() -> None:
    (count,) = tree(render_diagnosis(_warned())).every("p", "count")
    (link,) = count.every("a")
    assert (link.text, link.attributes["href"]) == ("Findings and remarks: 5", "#notices")
    silent = tree(render_diagnosis(replace(diagnosis(), remarks=())))
    assert not list(silent.every("p", "count"))
    (section,) = (part for part in silent.every("section") if part.attributes["id"] == "notices")
    assert "None: the fits converged" in section.text


def test_a_blocking_finding_is_the_next_thing_to_do() -> None:
    first = next(tree(render_diagnosis(_warned())).every("div", "next")).text
    assert first.startswith("What to do next Mend v1 at 3 s: cut there.")
    assert "look at the video" not in first
