"""The plan: options ranked, and its form as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mjfish.design.menu import Run
from mjfish.design.question import Question
from mjfish.files import write_json

SCHEMA = 1


@dataclass(frozen=True)
class Pair:
    """What an option does for two rivals, or for one cause that is to be seen (`second` is empty then).

    Attributes:
        first, second: names.
        now, after: lambda, the misfit of the wrong one that no refit hides, in units of the noise; of a cause to be
            seen: the smallest visible size of its amplitude that is best seen.
        chance_now, chance_after: that the right one is told; now: that the verdict that the data give already is right.
        settled: measured directly by a calibration.
    """

    first: str
    second: str
    now: float
    after: float
    chance_now: float
    chance_after: float
    settled: bool = False


@dataclass(frozen=True, eq=False)
class Option:
    """A run or calibration.

    Attributes:
        kind: ``calibration`` or ``run``.
        name: of it.
        about: what is done.
        seconds: of swimming, with the pause before it; 0 for a calibration.
        pairs: what it does for each pair, or cause.
        worth: the smallest gain of any pair, a second: of lambda, or of -log of the smallest visible size.
        run: behind it.
    """

    kind: Literal["calibration", "run"]
    name: str
    about: str
    seconds: float
    pairs: tuple[Pair, ...]
    worth: float
    run: Run | None = None

    @property
    def worst(self) -> Pair:
        """The pair with the smallest chance of a verdict; of causes to be seen, the one that gains least."""
        return min(
            self.pairs, key=lambda p: (p.chance_after, -p.after / max(p.now, 1e-300) if not p.second else p.after)
        )


@dataclass(frozen=True, eq=False)
class Plan:
    """What to do next.

    Attributes:
        dataset: name of the dataset.
        question: that is to be answered.
        options: calibrations that settle a pair first, then runs by worth.
        status: ``ok``, ``fit_not_converged``, or ``nothing_to_offer``.
        message: the advice in one sentence.
        remarks: what a reader should know.
    """

    dataset: str
    question: Question
    options: tuple[Option, ...]
    status: Literal["ok", "fit_not_converged", "nothing_to_offer"]
    message: str
    remarks: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[Option, ...]:
        """The runs, best first."""
        return tuple(option for option in self.options if option.run is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, in the layout of ``plan.json``."""
        return {
            "schema": SCHEMA,
            "dataset": self.dataset,
            "status": self.status,
            "message": self.message,
            "question": {
                "purpose": self.question.purpose,
                "names": list(self.question.names),
                "why": self.question.why,
            },
            "options": [_option(option) for option in self.options],
            "remarks": list(self.remarks),
        }

    def save(self, path: Path) -> None:
        """Write ``plan.json`` whole or not at all."""
        write_json(path, self.to_dict())


def _option(option: Option) -> dict[str, Any]:
    drive = option.run.trial.drive if option.run is not None else ()
    return {
        "kind": option.kind,
        "name": option.name,
        "about": option.about,
        "seconds": option.seconds,
        "worth": option.worth,
        "pairs": [dict(vars(pair)) for pair in option.pairs],
        "drive": [{"start": s.start, "omega": s.omega, "bias": list(s.bias)} for s in drive],
    }
