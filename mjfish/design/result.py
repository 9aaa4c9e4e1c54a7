"""The plan of the next experiment: the question, the options ranked, and the advice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from mjfish.design.menu import Run
from mjfish.drive.cpg import DriveSegment
from mjfish.errors import InputError
from mjfish.result import Result
from mjfish.serialise import unsaved

SCHEMA = 2
#: How many options a summary lists.
_LISTED = 5


@dataclass(frozen=True)
class Question:
    """What the next experiment is to answer.

    Attributes:
        purpose: ``separate`` rivals, or ``see`` causes that the data do not show.
        names: of the causes; empty with ``see``: all that apply.
        why: in a sentence.
    """

    purpose: Literal["separate", "see"]
    names: tuple[str, ...]
    why: str = ""

    def __post_init__(self) -> None:
        """Refuse rivals that are fewer than two or there twice."""
        if len(set(self.names)) < len(self.names):
            raise InputError(f"causes {', '.join(self.names)}: one is there twice; give each once")
        if self.purpose == "separate" and len(self.names) < 2:
            raise InputError(f"rivals: found {', '.join(self.names) or 'none'}, expected two or more; name another")


@dataclass(frozen=True)
class Pair:
    """What an option does for two rivals, or for one cause that is to be seen (`second` is empty then).

    Attributes:
        first, second: names.
        now, after: lambda, the misfit of the wrong one that no refit removes, in units of the noise; of a cause to be
            seen: the minimum detectable effect of its amplitude that is seen best.
        probability_now, probability_after: of the right verdict, with the data as they are and with the option.
        settled: measured directly by a calibration.
    """

    first: str
    second: str
    now: float
    after: float
    probability_now: float = math.nan
    probability_after: float = math.nan
    settled: bool = False


@dataclass(frozen=True, eq=False)
class Option:
    """A run or calibration.

    Attributes:
        kind: ``calibration`` or ``run``.
        name: of it.
        about: what is done.
        seconds: of swimming, with the pause before it; 0 for a calibration.
        worth: the smallest gain of any pair a second: of lambda, or of -log of the minimum detectable effect.
        pairs: what it does for each pair, or cause.
        drive: of a run by the CPG.
        run: behind it.
    """

    kind: Literal["calibration", "run"]
    name: str
    about: str
    seconds: float
    worth: float
    pairs: tuple[Pair, ...]
    drive: tuple[DriveSegment, ...] = ()
    run: Run | None = unsaved(default=None)

    @property
    def worst(self) -> Pair:
        """The pair with the smallest probability of a verdict; of causes to be seen, the one that gains least."""
        return min(
            self.pairs,
            key=lambda p: (p.probability_after, p.after) if p.second else (0.0, -p.after / max(p.now, 1e-300)),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """What to do next.

    Attributes:
        dataset: name of the dataset.
        status: ``ok``, ``fit_not_converged``, or ``nothing_to_offer``.
        message: the advice in a few sentences.
        question: that is to be answered.
        options: calibrations that settle a pair first, then runs by worth.
        remarks: what a reader should know.
    """

    dataset: str
    status: Literal["ok", "fit_not_converged", "nothing_to_offer"]
    message: str
    question: Question
    options: tuple[Option, ...]
    remarks: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[Option, ...]:
        """The runs, best first."""
        return tuple(option for option in self.options if option.run is not None)

    @property
    def calibrations(self) -> tuple[Option, ...]:
        """The calibrations, those that settle most pairs first."""
        return tuple(option for option in self.options if option.kind == "calibration")

    def summary(self) -> str:
        """Return question, advice and the first options, a line each."""
        lines = [f"Plan for {self.dataset} ({self.status}): {self.question.why}", self.message]
        for option in self.options[:_LISTED]:
            pair = option.worst
            after = "measured directly" if pair.settled else f"{pair.now:.3g} now, {pair.after:.3g} after"
            lines.append(f"  {option.name}: {after}")
        if len(self.options) > _LISTED:
            lines.append(f"  and {len(self.options) - _LISTED} more")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, the content of ``plan.json``."""
        return {"schema": SCHEMA, **super().to_dict()}


def percent(probability: float) -> str:
    """Return a probability as text, never as a certainty that it is not."""
    if math.isnan(probability):
        return ""
    return "> 99 %" if 0.995 <= probability < 1.0 else f"{100.0 * probability:.0f} %"
