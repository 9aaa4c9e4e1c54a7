"""Answers to sealed cases, as pieces of a study: every truth is sealed before the first case is diagnosed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.diagnosis import Diagnosis, diagnose
from mjfish.errors import InputError
from mjfish.study import Piece, Ran, Store
from mjfish.study import run as run_pieces
from studies.battery.generator.case import STRENGTHS, Case, make_case
from studies.battery.generator.classes import MECHANISMS
from studies.battery.generator.draft import PIKE
from studies.battery.generator.truth import Truth
from studies.battery.sparse_regression import sparsest


@dataclass(frozen=True)
class Task:
    """One case to draw, seal and diagnose."""

    kind: str
    seed: int
    split: str
    strength: float | None = None
    least: float = STRENGTHS[0]
    noise: str | None = None
    disturbance: str = "none"
    cause: str | None = None
    joints: int = PIKE

    @property
    def name(self) -> str:
        """Name of its case."""
        parts = [
            self.kind,
            str(self.seed),
            self.cause or "",
            self.noise or "",
            "" if self.disturbance == "none" else self.disturbance,
            "" if self.joints == PIKE else f"{self.joints}joints",
        ]
        return "-".join(part for part in parts if part)


@dataclass(frozen=True)
class _OfTask(Piece):
    """A piece of work on a case, which it draws."""

    task: Task

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.task.name

    @property
    def input(self) -> dict[str, Any]:
        """The task, and what is asked of it."""
        return {type(self).__name__.lower(): vars(self.task), "version": version("mjfish")}


class Sealed(_OfTask):
    """The truth of a case."""

    def result(self) -> dict[str, Any]:
        """Return the truth as plain data, and its hash."""
        truth = _draw(self.task, rivals=self.task.kind == "one" and self.task.joints == PIKE).truth
        return {"truth": dataclasses.asdict(truth), "seal": truth.seal}


class Answered(_OfTask):
    """The diagnosis of a case."""

    def result(self) -> dict[str, Any]:
        """Return what is judged of it."""
        case = _draw(self.task)
        answer = told(diagnose(case.dataset, jobs=1))
        if self.task.noise == "poses":  # the floor and the sparsest regression are of velocities
            return {**answer, "floor": None, "sparse": None}
        answer["floor"] = floor(case)
        return {**answer, "sparse": sparsest(case.dataset)} if self.task.kind == "one" else answer


def run(tasks: Sequence[Task], folder: Path, **options: Any) -> Ran:
    """Draw and seal the truths that are missing in `folder`, then make the diagnoses that are; see `mjfish.study.run`.

    Args:
        tasks: all of them.
        folder: of truths and answers.
        options: of `mjfish.study.run`.
    """
    run_pieces([*map(Sealed, tasks)], folder / "truth", **options)
    return run_pieces([*map(Answered, tasks)], folder / "answer", **options)


def floor(case: Case) -> float | None:
    """Return the error that noise alone leaves on held-out trials, as gains count it; None: nothing held out."""
    pairs = [(t, clean) for t, clean in zip(case.dataset.trials, case.clean, strict=True) if t.role == "held_out"]
    if not pairs:
        return None
    measured = np.concatenate([trial.velocity for trial, _ in pairs])
    noise = measured - np.concatenate([clean for _, clean in pairs])
    return float(np.mean(np.sqrt(np.mean(noise**2, axis=0)) / np.ptp(measured, axis=0)))


def _draw(task: Task, *, rivals: bool = False) -> Case:
    return make_case(
        task.seed, task.kind, split=task.split, cause=task.cause, strength=task.strength, least=task.least,
        noise_kind=task.noise, disturbance=task.disturbance, rivals=rivals, joints=task.joints,
    )  # fmt: skip


#: What of the row of a candidate is judged.
_REFITTED = ("gain", "rival_p", "error", "held_out_error")


def told(result: Diagnosis) -> dict[str, Any]:
    """Return what of a diagnosis is judged, as plain data."""
    plain = result.to_dict()
    kept = (
        "verdict",
        "message",
        "status",
        "remarks",
        "alternatives",
        "certain",
        "p_wrong",
        "gain",
        "mechanisms",
        "domain",
    )
    return {
        **{key: plain[key] for key in kept},
        "causes": {cause["name"]: cause["parameters"] for cause in plain["causes"]},
        "coefficients": plain["coefficients"]["extended"],
        "candidates": [
            {"name": one.name, "score": one.score, **{key: getattr(one.row, key, None) for key in _REFITTED}}
            for one in result.candidates
            if one.applicable
        ],
        "where": plain["where"]["channel"] if plain["where"] else None,
        "severity": plain["checks"]["severity"],
    }


@dataclass(frozen=True)
class Judged:
    """A truth and the answer to it."""

    truth: Truth
    answer: Mapping[str, Any]

    @property
    def named(self) -> frozenset[str]:
        """The causes that were named."""
        return frozenset(self.answer["causes"])

    @property
    def right(self) -> bool:
        """Whether exactly the true causes were named."""
        return self.named == frozenset(self.truth.causes)

    @property
    def mechanisms(self) -> frozenset[str]:
        """The mechanisms that were named."""
        return frozenset(one["name"] for one in self.answer.get("mechanisms", ()))

    @property
    def right_mechanisms(self) -> bool:
        """Whether exactly the mechanisms of the true causes were named."""
        return self.mechanisms == frozenset(MECHANISMS.get(name, name) for name in self.truth.causes)


@dataclass(frozen=True)
class _Done:
    """An answer, and the truth that is sealed."""

    task: Task
    sealed: dict[str, Any]
    answer: dict[str, Any]


def _done(folder: Path) -> list[_Done]:
    """Return all answers of a folder by the names of their cases.

    Raises:
        InputError: a truth is missing, a file was changed, or a piece failed.
    """
    truths, answers = Store(folder / "truth"), Store(folder / "answer")
    found = []
    for key in answers.keys():  # noqa: SIM118 - no dictionary
        asked = Task(**_read(answers, key)["input"]["answered"])
        sealed = _read(truths, Sealed(asked).key)["result"]
        found.append(_Done(asked, sealed, {**_read(answers, key)["result"], "seconds": answers.seconds(key) or 0.0}))
    return sorted(found, key=lambda one: one.task.name)


def _read(store: Store, key: str) -> dict[str, Any]:
    content = store.read(key)
    if content is None or content["outcome"] == "failed":
        reason = "is missing" if content is None else f"failed: {content['reason']}"
        raise InputError(f"{store.folder}: the piece {key} {reason}; run the battery with this case again")
    return content


def judged(folder: Path) -> list[Judged]:
    """Open the truths of all answers in a folder, each checked against its hash."""
    return [Judged(Truth.of(one.sealed["truth"]), one.answer) for one in _done(folder)]


def sealed_answers(folder: Path) -> list[dict[str, Any]]:
    """Return, by case, the hash of its sealed truth and the answer in short; truths stay shut."""
    return [
        {
            "case": one.task.name,
            "truth": one.sealed["seal"],
            **{key: one.answer[key] for key in ("verdict", "message", "alternatives", "seconds")},
            "mechanisms": [
                {key: mechanism[key] for key in ("name", "level", "form", "forms")}
                for mechanism in one.answer["mechanisms"]
            ],
        }
        for one in _done(folder)
    ]
