"""What a fish is made of, and what is odd about it."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.fish import Fish
from mjfish.fish.body_summary import summarise
from mjfish.hydro.link import link_records


def test_added_masses_are_those_of_the_force(pike: Fish) -> None:
    records = link_records(pike)
    for link, record in zip(summarise(pike).links, records, strict=True):
        assert link.added == pytest.approx(record["c_m"] * record["added"][0])
        assert link.added_inertia == pytest.approx(record["c_m"] * record["added"][2])


def test_the_drawing_has_the_joints_and_the_height(pike: Fish) -> None:
    drawing = summarise(pike, columns=72).drawing
    middle = drawing[len(drawing) // 2]
    bars = [column for column, letter in enumerate(middle) if letter == "|"]
    ends = np.cumsum([link.length for link in pike.links[:-1]])
    np.testing.assert_array_equal(bars, (ends / pike.length * 72).astype(int))
    tall = sum(line[30] == "#" for line in drawing if len(line) > 30)
    assert tall == pytest.approx(0.096 / (2.0 * pike.length / 72), abs=1.0)
    assert max(map(len, drawing)) <= 72


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"mass": 15.0}, "it would sink"),
        ({"mass": 0.15}, "displaces 1.4 kg of water. Check its mass"),
        ({"com": 0.4}, "The centre of mass of head is 0.4 m behind its front, its length is 0.291 m"),
        ({"inertia": 3.0}, "The inertia of head is 3 kg m2"),
    ],
)
def test_what_is_odd_is_said(pike: Fish, changes: dict[str, float], complaint: str) -> None:
    head = pike.links[0].model_copy(update=changes)
    odd = summarise(pike.model_copy(update={"links": (head, *pike.links[1:])})).odd
    assert any(complaint in sentence for sentence in odd)
    assert not any(complaint in sentence for sentence in summarise(pike).odd)


def test_a_section_thinner_than_the_fin_is_odd(pike: Fish) -> None:
    body, fin = pike.sections[1], pike.sections[-1]
    thin = body.model_copy(update={"width": (0.9 * max(fin.width), 0.9 * max(fin.width))})
    odd = summarise(pike.model_copy(update={"sections": (pike.sections[0], thin, *pike.sections[2:])})).odd
    assert sum("Section 2" in sentence and "thinner than the fin" in sentence for sentence in odd) == 1
    assert not any("thinner" in sentence for sentence in summarise(pike).odd)
