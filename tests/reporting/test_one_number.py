"""One number for one thing: what JSON, page, terminal and summary say of a diagnosis is the same, number by number."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from diagnosed import diagnosis, learned_diagnosis
from html_tree import Element, tree

from mjfish.cli import console
from mjfish.cli.diagnosis_text import show
from mjfish.diagnosis import Diagnosis, Estimate
from mjfish.inspection import Finding, Inspection
from mjfish.numerics.formats import channel_name, number, p_value, percent
from mjfish.reporting.html.diagnosis import render_diagnosis

#: A number as people write it: with a minus, a power of ten, or a percent sign.
_NUMBER = re.compile(r"(?<![\w.⁻])−?\d+(?:\.\d+)?(?: × 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?(?: %)?(?![\w.]*\w)")
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def _worse() -> Diagnosis:
    """Return a diagnosis whose cause makes the held-out runs worse, with a large missing force, and suspect data."""
    found = diagnosis("unexplained")
    assert found.gain is not None
    gain = replace(
        found.gain, extended=dict.fromkeys(found.gain.nominal, 0.0319), relative_reduction=-0.016, low=-0.05, high=0.02
    )
    stuck = Finding("stuck", "suspect", "slow, surge, 1.2 s", "12 samples are equal", "noise", "record it again")
    force = tuple(replace(one, driving=one.driving / 30.0) for one in found.force)
    return replace(found, gain=gain, checks=Inspection((stuck,)), force=force)


def _late() -> Diagnosis:
    """Return a diagnosis of servos that says how late the joints are."""
    found, delay = diagnosis("named"), {"2.23 Hz": Estimate(19.31, 19.02, 19.6, "ms")}
    late = found.table.described(lambda row: replace(row, delays=delay) if row.names == ("servo_lag",) else row)
    return replace(found, table=late)


FOUND = {
    "named": _late(),
    "learned": learned_diagnosis(),
    "worse": _worse(),
    "cannot_tell": diagnosis("cannot_tell"),
}


@pytest.fixture(params=FOUND, scope="module")
def found(request: pytest.FixtureRequest) -> Diagnosis:
    """A diagnosis."""
    return FOUND[request.param]


@pytest.fixture
def terminal(found: Diagnosis, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """All that the terminal shows, in lines that do not end before their sentence."""
    monkeypatch.setattr(console.out, "_width", 2000)
    monkeypatch.setattr(console, "program", lambda: "mjfish")
    show(found, "DATASET", verbose=True)
    return _plain(capsys.readouterr().out)


@pytest.fixture(scope="module")
def page(found: Diagnosis) -> Element:
    """The page, without its scripts."""
    return tree(render_diagnosis(found))


def _plain(text: str) -> str:
    return text.replace("\N{NO-BREAK SPACE}", " ")


def _text(page: Element) -> str:
    """Return what a reader sees of a page, and what its folded parts have."""
    return _plain(next(page.every("main")).text if list(page.every("main")) else page.text)


def _sentences(found: Diagnosis) -> Iterator[str]:
    """Yield what the JSON says in sentences that every reader must see."""
    written = json.loads(json.dumps(found.to_dict()))
    yield from (written["message"], *written["remarks"], *written["next"])
    yield from (finding["message"] for finding in written["checks"]["findings"])
    if found.gain is not None and found.best:
        yield found.gain.change
    yield from (mechanism.told for mechanism in found.mechanisms if mechanism.curves)


def test_every_sentence_is_the_same_wherever_it_stands(found: Diagnosis, terminal: str, page: Element) -> None:
    seen = _text(page)
    for sentence in map(_plain, _sentences(found)):
        assert sentence in terminal, sentence
        assert sentence[1:] in seen, sentence  # at the start of a paragraph, with a capital
    summary = _plain(found.summary())
    assert f"Next: {found.next[0]}." in summary
    for told in found.delays:
        assert all(told in _plain(text) for text in (terminal, seen, summary)), told
    assert found.held_out == "" or (_plain(found.held_out) in summary and _plain(found.held_out) in terminal)


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers of plain data."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, (int, float)):
        yield float(value)
    elif isinstance(value, dict):
        for key, own in value.items():
            yield from _numbers(own)
            yield from (float(key.removesuffix(" Hz")),) if key.endswith(" Hz") else ()
    elif isinstance(value, list):
        for own in value:
            yield from _numbers(own)


def _told(text: str) -> Iterator[tuple[str, float, float]]:
    """Yield every number of a text: as it stands, what it is, and half a unit of its last place."""
    for match in _NUMBER.finditer(text):
        mantissa, _, power = match.group().removesuffix(" %").partition(" × 10")
        scale = 10.0 ** int(power.translate(_DIGITS) or 0) / (100.0 if match.group().endswith("%") else 1.0)
        places = len(mantissa.partition(".")[2])
        yield match.group(), float(mantissa.replace("−", "-")) * scale, 0.5000001 * 10.0**-places * scale


def test_every_number_of_the_terminal_is_one_of_the_json(found: Diagnosis, terminal: str) -> None:
    """Rounded; but for thresholds, counts, changes of errors, and what stands in sentences of the JSON."""
    written = json.loads(json.dumps(found.to_dict()))
    known = sorted({*_numbers(written), *_derived(found)})
    rest = terminal
    for sentence in map(_plain, _words(written)):
        rest = rest.replace(sentence, "")
    for row in re.findall(r"^.*(?:LR: fall|Minimum detectable|lowest fifth|values of smooth).*$", rest, re.MULTILINE):
        rest = rest.replace(row, "")
    for text, value, half in _told(rest):
        assert any(abs(value - one) <= half or math.isclose(value, one) for one in known), (text, _around(rest, text))


def _around(text: str, what: str) -> str:
    at = text.index(what)
    return text[max(at - 60, 0) : at + 40]


def _words(value: Any) -> Iterator[str]:
    """Yield all texts of plain data that have a space, the longest first."""
    texts = [value] if isinstance(value, str) else []
    if isinstance(value, (dict, list)):
        texts = [text for own in (value.values() if isinstance(value, dict) else value) for text in _words(own)]
    yield from sorted((text for text in texts if " " in text), key=len, reverse=True)


def _derived(found: Diagnosis) -> Iterator[float]:
    """Yield what follows from numbers of the JSON: by how much errors change, and curves at the ends of their range."""
    if found.gain is not None:
        pairs = [(before, found.gain.extended[name]) for name, before in found.gain.nominal.items()]
        yield from (abs(1.0 - after / before) for before, after in (*pairs, found.gain.mean_speed_error))
        yield from map(abs, (found.gain.low, found.gain.high, found.gain.relative_reduction))
    for mechanism in found.mechanisms:
        for curve in (curve for curve in mechanism.curves if curve.seen):
            yield from (value for x in curve.seen or () for value in (x, *curve.at(x)))


def test_sizes_have_one_form_everywhere(found: Diagnosis, terminal: str, page: Element) -> None:
    seen, summary = _text(page), _plain(found.summary())
    for cause in found.causes:
        for name, value in cause.parameters.items():
            if f"{cause.name}.{name} " not in terminal:  # a value of a smooth curve
                continue
            assert f"{cause.name}.{name} {value.told}" in terminal
            assert f"{cause.name}.{name} = {value.told}" in summary or len(summary.splitlines()) == 10
            assert f"95 %: {value.interval}" in seen
            assert f" {value.rounded} " in seen


def test_errors_of_channels_are_those_of_the_page(found: Diagnosis, terminal: str, page: Element) -> None:
    assert found.gain is not None
    (table,) = page.every("table", "errors")
    rows = {next(row.every("th")).text: [_plain(cell.text) for cell in row.every("td")] for row in table.every("tr")}
    lines = (re.split(r"\s{2,}", line.strip()) for line in terminal.splitlines())
    printed = {cells[0]: cells[1:] for cells in lines}
    for name, values, _, _ in found.gain.rows:
        assert [cell for cell in rows[channel_name(name)] if cell] == printed[channel_name(name)]
        told = percent(values[0]) if name != "mean_speed" else f"{number(values[0])} m/s"
        assert printed[channel_name(name)][0] == _plain(told)


def test_the_rows_of_the_evidence_are_those_of_the_page(found: Diagnosis, terminal: str, page: Element) -> None:
    (table,) = page.every("table", "evidence")
    rows = {next(row.every("th")).text: [_plain(c.text) for c in row.every("td")] for row in table.every("tr")}
    for row in found.table.rows:
        cells = rows[" + ".join(row.names)]
        line = next(
            line
            for line in terminal.splitlines()
            if line.strip().startswith(f"{' + '.join(row.names)}  ")
            or line.strip().startswith(f"{' + '.join(row.names)} ")
        )
        told = [number(row.gain), number(row.behind), p_value(row.rival_p), percent(row.chosen)]
        told += [percent(row.remaining), p_value(row.fit_p)] if row.tests else ["–", "–"]
        assert [_plain(one) for one in told] == [*cells[:4], cells[4].partition(" (")[0], cells[5]]
        assert all(_plain(one) in line for one in told), line


def test_servos_say_how_late_the_joints_are() -> None:
    """A lag of 40 ms was told as 0.0119 s with a damping of 1.77."""
    found = FOUND["named"]
    assert found.delays == ("19.31 ms (19.02 to 19.60) at 2.23 Hz",)
    (row,) = (one for one in found.to_dict()["table"]["rows"] if one["names"] == ["servo_lag"])
    assert row["delays"]["2.23 Hz"]["estimate"] == 19.31


def test_a_missing_force_is_a_multiple_and_a_larger_error_is_more() -> None:
    """Users read "202 %", and "less by −1.6 %"."""
    found = FOUND["worse"]
    text = _text(tree(render_diagnosis(found)))
    assert max(found.force[0].share) > 1.0
    assert f"{number(found.force[0].share[1])}" in text
    assert "1.60 % more (5.00 % more to 2.00 % less)" in text
    assert not re.search(r"−[\d.]+ %", text)


def test_one_of_something_is_no_plural(page: Element) -> None:
    """Users read "1 causes"."""
    assert not re.search(r"\b1 (causes|trials|samples|values|remarks|sizes)\b", _text(page))
