"""The report as a reader gets it: one file, all verdicts, nothing from outside, nothing unescaped."""

from __future__ import annotations

import functools
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from diagnosed import LAG, diagnosis, page

from mjfish.diagnosis import Candidate, Diagnosis, Estimate
from mjfish.diagnosis.result import Verdict
from mjfish.errors import InputError
from mjfish.reporting.html.diagnosis import render_diagnosis, shares, whiskers, write_diagnosis

VERDICTS: tuple[Verdict, ...] = ("named", "nothing_wrong", "cannot_tell", "unexplained")


class _Page(HTMLParser):
    """Tags with their attributes, the text outside scripts and styles, and the scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self._figures: dict[str, dict] = {}
        self._words: list[str] = []
        self.feed(html)
        self.text = " ".join(" ".join(self._words).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        tag, attributes = self.tags[-1] if self.tags else ("", {})
        if self.cdata_elem == "script":
            self.scripts.append((attributes, data))
            if attributes.get("type") == "application/json":
                self._figures[str(self.tags[-2][1]["aria-label"])] = json.loads(data)
        elif self.cdata_elem is None or tag not in ("script", "style"):
            self._words.append(data)

    def figures(self) -> dict[str, dict]:
        """Return the figures by their labels."""
        return self._figures


def _page(found: Diagnosis) -> _Page:
    return _Page(render_diagnosis(found))


@functools.cache
def _shown(verdict: Verdict = "named", *, held_out: bool = True) -> _Page:
    """Return the page of a diagnosis with this verdict, read once."""
    return _Page(page(verdict, held_out=held_out))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_is_told_first_and_with_its_colour(verdict: Verdict) -> None:
    seen = _shown(verdict)
    badge = {"named": "Cause named", "nothing_wrong": "Nothing wrong"}.get(verdict, verdict.replace("_", " "))
    assert badge.lower() in seen.text[:250].lower()
    assert f"Something to say about {verdict}." in seen.text[:400]
    assert ("header", {"class": verdict}) in seen.tags


def test_the_file_asks_for_nothing_from_outside() -> None:
    html = page()
    seen = _Page(html)
    assert not [attributes for _, attributes in seen.tags if {"src", "srcset", "data"} & set(attributes)]
    assert all(str(attributes["href"]).startswith("#") for _, attributes in seen.tags if "href" in attributes)
    styles = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in styles
    assert "@import" not in styles
    policy = next(a["content"] for tag, a in seen.tags if tag == "meta" and "http-equiv" in a)
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert html.count("* plotly.js v") == 1


def test_a_named_cause_comes_with_its_parameter_interval_and_unit() -> None:
    text = _shown().text
    assert "servo_lag.time_constant 0.02010 s 95 %: 0.01950 to 0.02070 s" in text
    assert "log the joint angles on the bench while the command steps" in text  # the experiment


def test_the_gain_is_told_per_channel_and_pooled_with_its_interval() -> None:
    text = _shown().text.replace("\N{NO-BREAK SPACE}", " ")
    for name, before, after, less in (
        ("surge", "3.10 %", "1.10 %", "64.5 % less"),
        ("yaw rate", "4.23 %", "1.30 %", "69.3 % less"),
        ("all channels", "3.14 %", "1.20 %", "61.8 % less (57.0 % to 66.0 %)"),
        ("mean speed", "0.0123 m/s", "0.00210 m/s", "82.9 % less"),
    ):
        assert f"{name} {before} {after} {less}" in text


def test_a_gain_that_may_be_none_is_said_to_be_uncertain() -> None:
    found = diagnosis()
    assert found.gain is not None
    assert "no gain is certain" not in _page(found).text
    assert "no gain is certain" in _page(replace(found, gain=replace(found.gain, low=-0.01))).text


def test_without_a_held_out_trial_the_page_says_what_to_record() -> None:
    seen = _shown(held_out=False)
    assert "No trial was held out" in seen.text
    assert "held_out" in seen.text
    labels = list(seen.figures())
    assert labels[0].endswith("where the nominal model is worst")
    assert labels[1:] == [
        "velocities and residuals of trial slow", "velocities and residuals of trial fast",
        "mean residual over the phase of the beat", "mean residual over the surge of the nominal model",
        "missing force of trial slow", "missing force of trial fast",
    ]  # fmt: skip


def test_when_nothing_is_wrong_only_the_nominal_model_is_shown() -> None:
    seen = _shown("nothing_wrong")
    for figure in seen.figures().values():
        assert {trace.get("name") for trace in figure["data"]} <= {"measured", "nominal", None}
    assert "extended model" not in seen.text
    assert "Error on held-out trials channel nominal surge 3.10 % sway" in seen.text.replace("\N{NO-BREAK SPACE}", " ")
    assert "the minimum detectable effect is time_constant 5.8 × 10⁻⁵ s." in seen.text


def test_rivals_are_listed_each_with_the_experiment_that_tells_them_apart() -> None:
    text = _shown("cannot_tell").text
    told = text[text.index("What to do next") :]
    assert "flash a light in the camera" in told
    assert "log the joint angles on the bench" in told


def test_an_unexplained_misfit_sends_the_reader_to_a_cause_of_their_own() -> None:
    assert "mjfish diagnose DATASET --effects my_effects.py" in _shown("unexplained").text


def test_a_fit_that_did_not_converge_is_told_at_the_top() -> None:
    seen = _page(replace(diagnosis(), status="fit_not_converged"))
    assert "fit not converged" in seen.text[:600]


def test_what_users_wrote_is_text_and_never_markup() -> None:
    """Names of datasets, trials, files, remarks and causes come from files of other people."""
    evil = "</script><img src=x onerror=alert(1)>"
    found = diagnosis(names=(evil, "{{ 7 * 7 }}"))
    found = replace(
        found,
        dataset=replace(found.dataset, name=evil),
        message=evil,
        remarks=(evil,),
        candidates=(*found.candidates, Candidate(evil, False, remark=evil)),
        provenance={**found.provenance, "inputs": {evil: evil}},
    )
    seen = _page(found)
    plain = _shown()
    assert [tag for tag, _ in seen.tags if tag == "img"] == []
    assert len(seen.scripts) == len(plain.scripts)
    assert seen.text.count(evil) >= 6
    assert "{{ 7 * 7 }}" in seen.text


def test_figures_show_the_measured_and_simulated_velocities_held_out_first() -> None:
    found = diagnosis()
    seen = _page(found)
    assert seen.text.index("fast held out") < seen.text.index("slow 2.0 s")
    held = found.overlays[1]
    data = seen.figures()["velocities and residuals of trial fast"]["data"]
    by_panel = {(trace["name"], trace["yaxis"]): trace for trace in data}  # panels are numbered row by row
    np.testing.assert_allclose(by_panel["measured", "y5"]["y"], held.trial.velocity[:, 2], rtol=1e-4, atol=1e-9)
    scored = np.abs(held.trial.time - 1.2) > 0.03  # a step of the drive at 1.2 s: nothing is scored beside it
    left = held.trial.velocity[:, 1] - held.nominal[:, 1]
    for key, values in ((("extended", "y"), held.extended[:, 0]), (("nominal", "y4"), left)):
        drawn = np.array(by_panel[key]["y"], dtype=float)  # None becomes NaN
        np.testing.assert_array_equal(np.isfinite(drawn), scored)
        np.testing.assert_allclose(drawn[scored], values[scored], rtol=1e-4, atol=1e-9)
    assert by_panel["nominal", "y4"]["x"] == pytest.approx(held.trial.time, abs=1e-9)


def test_a_rollout_that_diverged_leaves_a_gap_in_the_curve() -> None:
    found = diagnosis()
    broken = found.overlays[1].nominal.copy()
    broken[70:] = np.nan
    seen = _page(replace(found, overlays=(found.overlays[0], replace(found.overlays[1], nominal=broken))))
    curve = next(
        trace["y"]
        for trace in seen.figures()["velocities and residuals of trial fast"]["data"]
        if trace["name"] == "nominal"
    )
    assert curve[69] is not None
    assert curve[70:] == [None] * (len(broken) - 70)


def test_the_report_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_diagnosis(diagnosis(), path)
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(InputError, match=r"absent/report\.html"):
        write_diagnosis(diagnosis(), tmp_path / "absent" / "report.html")


def test_estimates_of_the_extended_model_stand_beside_the_nominal_ones() -> None:
    text = _shown().text
    told = text[text.index("model with 95 % intervals") :]
    assert "servo_lag.time_constant" in told
    assert f"– {LAG.estimate:.5f}" in told  # the nominal model has no such parameter
    assert "bound" in told[told.index("c_f.head") : told.index("c_f.body")]


def test_what_remains_is_shown_only_of_candidates_in_the_race() -> None:
    """Columns of a candidate: evidence, p, against the best, what remains, ..."""
    rows = _rows("cannot_tell")
    assert [rows[name][3] for name in ("servo_lag", "time_offset", "tail_compliance")] == ["0.31", "0.31", "–"]
    assert {cells[2] for cells in _rows("nothing_wrong").values() if len(cells) > 1} == {"–"}


def test_causes_that_are_named_or_possible_are_marked() -> None:
    html = page("cannot_tell")
    marked = re.findall(r'<tbody class="chosen">\s*<tr>\s*<th scope="row">[^<]*<code>(\w+)</code>', html)
    assert marked == ["servo_lag", "time_offset"]


def _rows(verdict: Verdict) -> dict[str, list[str]]:
    """Return the numbers of every candidate as the page shows them."""
    html = page(verdict)
    row = r'<tbody class="[ a-z]*">\s*<tr>\s*<th scope="row">[^<]*<code>(\w+)</code></th>(.*?)</tr>'
    bodies = re.findall(row, html, re.DOTALL)
    return {name: re.findall(r'<td class="number" data-label="[a-z -]*">([^<]*)', cells) for name, cells in bodies}


def test_where_it_goes_wrong_is_listed_in_the_order_of_channels_and_swimming() -> None:
    channels, trials, parts, phases, *_ = shares(diagnosis())
    assert channels == ("channel", "yaw rate", {"surge": 0.2, "sway": 0.3, "yaw rate": 0.5})
    assert list(parts[2]) == ["start-up", "steady"]
    assert len(trials[2]) == 1
    assert phases[1] == next(iter(phases[2]))
    assert shares(diagnosis("nothing_wrong")) == []
    html = page().replace("\N{NO-BREAK SPACE}", " ")
    bars = re.findall(r'class="share( chief)?"><span>(\w[\w ]*)</span>.*?width:([0-9.]+)%.*?number">(\d+ %)', html)
    assert bars[:3] == [
        ("", "surge", "40.0", "20 %"),
        ("", "sway", "60.0", "30 %"),
        (" chief", "yaw rate", "100.0", "50 %"),
    ]


def test_what_describes_the_misfit_is_told_below_where_it_sits() -> None:
    assert "A description, not a cause" not in _shown().text
    described = _shown("unexplained").text.replace("\N{NO-BREAK SPACE}", " ")
    assert "A description, not a cause, of 60 % of the misfit: a moment on every link ~ u v (size −0.20 SI" in described


def test_whiskers_keep_their_place_between_the_ends_of_both_intervals() -> None:
    nominal, extended = Estimate(2.5, 2.25, 2.75, "-"), Estimate(3.0, 2.8, 3.2, "-")
    below, above = whiskers(nominal, extended)
    assert above["at"] == pytest.approx(6.0 + 88.0 * (3.0 - 2.25) / (3.2 - 2.25), abs=0.01)
    assert (below["low"], above["high"]) == (6.0, 94.0)


def test_how_much_is_missing_is_told_as_a_share_of_what_moves_the_fish() -> None:
    """A sine of 0.1 N has 0.071 N root mean square; 1 N moves the fish."""
    found = diagnosis()
    assert found.force[0].share[0] == pytest.approx(0.071, abs=0.002)
    surge, sway = found.force[0].share[:2]
    assert f"slow {surge:.4f} {sway:.3f}" in _page(found).text
