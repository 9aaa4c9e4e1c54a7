"""The advice in one sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mjfish.design.question import Question
from mjfish.design.result import Option

#: Below this chance of a verdict a run is not worth its name.
_LIKELY = 0.5
#: Above this one the data tell already.
_TOLD = 0.5


def message(question: Question, options: Sequence[Option]) -> str:
    """Say what to do first."""
    calibrations = [option for option in options if option.kind == "calibration"]
    runs = [option for option in options if option.kind == "run"]
    parts = []
    if calibrations:
        first = calibrations[0]
        parts.append(f"First {first.name}, which costs no swimming: {first.about}.")
    if runs:
        parts.append(_run(question, runs[0], bool(calibrations)))
    if not options:
        parts.append(
            "Nothing on the menu would help: the fish has no run that it can swim, or every cause is invisible."
        )
    return " ".join(parts)


def _run(question: Question, best: Option, after: bool) -> str:
    lead = "Of the runs, " if after else ""
    what = f"{lead}{best.name} ({best.about})"
    what = what[0].upper() + what[1:]
    if question.purpose == "see":
        pair = best.worst
        return f"{what} shrinks the smallest visible size of every cause, at least to {pair.after / pair.now:.0%}."
    pair = best.worst
    if pair.chance_now > _TOLD:
        return f"The data tell {pair.first} and {pair.second} apart already; {best.name} would do so most a second."
    now, then = percent(pair.chance_now), percent(pair.chance_after)
    told = (
        f"{what} separates {pair.first} and {pair.second} most a second: chance of a verdict {now} now, {then} after."
    )
    if pair.chance_after < _LIKELY:
        told += " No single run of the menu is likely to decide; several may."
    return told


def percent(chance: float) -> str:
    """Return a chance as text, never as a certainty that it is not."""
    if math.isnan(chance):
        return ""
    return "> 99 %" if 0.995 <= chance < 1.0 else f"{100.0 * chance:.0f} %"
