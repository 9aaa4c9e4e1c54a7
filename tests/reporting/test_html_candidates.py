"""What is said of every candidate in words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from diagnosed import diagnosis

from mjfish.diagnosis import Candidate, Diagnosis
from mjfish.diagnosis.held_out import Confirmation
from mjfish.diagnosis.result import Verdict
from mjfish.reporting.html.candidates import remark


def _said(found: Diagnosis) -> dict[str, str]:
    return {candidate.name: remark(candidate, found) for candidate in found.candidates}


def _remarks(verdict: Verdict) -> dict[str, str]:
    return _said(diagnosis(verdict))


def test_every_candidate_is_judged_in_words() -> None:
    named = _remarks("named")
    assert named["servo_lag"] == "The cause: with it in the model nothing systematic is left."
    assert named["time_offset"].startswith("Ruled out: servo_lag explains")
    assert "removes 97" in named["time_offset"]
    assert named["tail_compliance"].endswith("On its bound: damping.")
    assert named["ambient_current"] == "Not tried: the heading was not recorded."
    assert _remarks("cannot_tell")["time_offset"].startswith("Possible: the data cannot tell it")
    assert "something systematic is left" in _remarks("unexplained")["servo_lag"]
    assert _remarks("nothing_wrong")["servo_lag"].startswith("No sign of it; ")


def _with_row(candidate: Candidate, **changed: Any) -> Candidate:
    assert candidate.row is not None
    return replace(candidate, row=replace(candidate.row, **changed))


def _leaving(candidate: Candidate) -> Candidate:
    """Return a candidate that leaves something systematic."""
    return _with_row(candidate, tests={"waves": 1e-9})


def test_a_candidate_that_fits_but_gains_nothing_is_said_to_do_so() -> None:
    found = diagnosis("unexplained")
    best = _with_row(found.candidates[0], tests={"waves": 0.5}, held_out=Confirmation(-3.0, 0.4))
    said = _said(replace(found, candidates=(best, *found.candidates[1:])))
    assert said["servo_lag"] == "Fits, but makes the held-out trials no better."


def test_what_was_not_refitted_is_said_to_be_so_and_not_to_be_absent() -> None:
    """Catches a cause with a trace, or one that is hidden, of which no sign is said to be."""
    found = diagnosis()
    best, second, *_ = found.candidates
    screened = replace(second, name="munk_moment", score_p=1e-9, confounded=0.2, row=None)
    absent = replace(screened, name="fin_lift", score_p=0.3, minimum_detectable={"fin_lift.slope": 0.8})
    hidden = replace(screened, name="mass_error", score_p=1.0, confounded=0.93)
    said = _said(replace(found, candidates=(best, screened, absent, hidden)))
    assert said["munk_moment"] == "Not refitted: others have better scores."
    assert said["fin_lift"] == "No sign of it; the minimum detectable effect is slope 0.80."
    assert said["mass_error"] == "Undetectable: a refit of the coefficients hides all of it."


def test_each_of_several_causes_is_said_to_be_one_whether_or_not_it_was_refitted_alone() -> None:
    found = diagnosis()
    best, second, third, _ = found.candidates
    pair = ("servo_lag", "munk_moment")
    beside = replace(second, name="munk_moment", confounded=0.2, row=None)
    cause = replace(found.causes[0], name="munk_moment")
    named = replace(
        found,
        candidates=(_leaving(best), beside, third),
        causes=(*found.causes, cause),
        best=pair,
        certain=pair,
        alternatives=(pair,),
    )
    said = _said(named)
    assert said["servo_lag"] == "One of the causes, beside munk_moment."
    assert said["munk_moment"] == "One of the causes, beside servo_lag."
    assert said["tail_compliance"].startswith("Ruled out as the only cause: servo_lag explains the misfit")
    sets = (pair, ("servo_lag", "tail_compliance"))
    split = replace(
        named, verdict="cannot_tell", causes=(), certain=("servo_lag",), alternatives=sets,
        rivals=(("munk_moment", "tail_compliance"),),
    )  # fmt: skip
    said = _said(split)
    assert said["servo_lag"] == "At work, whichever rival is the other cause."
    for name in ("munk_moment", "tail_compliance"):
        assert said[name].startswith("Possible: the data cannot tell it from its rivals."), name


def test_what_leaves_something_is_not_said_to_leave_nothing() -> None:
    """A cause of another form than the model's is named, or possible, and what it leaves is said."""
    left = "something systematic is left, 9.09\N{NO-BREAK SPACE}% of the misfit."
    found = diagnosis()
    best, *rest = found.candidates
    assert _said(replace(found, candidates=(_leaving(best), *rest)))["servo_lag"] == (
        f"The cause: with it in the model {left}"
    )
    found = diagnosis("cannot_tell")
    best, second, *rest = (_leaving(c) if c.row is not None and c.row.tests else c for c in found.candidates)
    tied = _said(replace(found, candidates=(best, second, *rest)))
    assert f"from its rivals, and with it {left}" in tied["time_offset"]
    alone = replace(found, candidates=(best, *rest), rivals=(), alternatives=(("servo_lag",),))
    assert _said(alone)["servo_lag"] == f"Possible, and the closest: with it {left}"
