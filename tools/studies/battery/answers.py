"""Answers to sealed cases: every truth is sealed before its case is diagnosed; a battery stopped half-way goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.diagnosis import Diagnosis, diagnose
from studies.battery.generator.case import STRENGTHS, Case, make_case
from studies.battery.generator.classes import MECHANISMS
from studies.battery.generator.draft import PIKE
from studies.battery.generator.truth import Truth, open_truth, seal
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
        """Name of its files."""
        parts = [
            self.kind,
            str(self.seed),
            self.cause or "",
            self.noise or "",
            "" if self.disturbance == "none" else self.disturbance,
            "" if self.joints == PIKE else f"{self.joints}joints",
        ]
        return "-".join(part for part in parts if part)


def run(tasks: Sequence[Task], folder: Path, jobs: int) -> Iterator[dict[str, Any]]:
    """Draw, seal and diagnose every task whose answer is not in `folder` yet; yield the answers as they come."""
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    (folder / "answer").mkdir(exist_ok=True)
    left = [task for task in tasks if not _answer(folder, task).is_file()]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_one, left, [folder] * len(left))


def _one(task: Task, folder: Path) -> dict[str, Any]:
    case = _draw(task)
    seal([case.truth], folder / "truth" / f"{task.name}.json")
    begun = time.process_time()
    answer = {"task": vars(task), **told(diagnose(case.dataset, jobs=1)), "cpu": time.process_time() - begun}
    answer["floor"] = floor(case)
    if task.kind == "one":
        answer["sparse"] = sparsest(case.dataset)
    target = _answer(folder, task)
    partial = target.with_suffix(".partial")
    partial.write_text(json.dumps(answer, indent=1), encoding="utf-8")
    partial.replace(target)
    return answer


def floor(case: Case) -> float | None:
    """Return the error that noise alone leaves on held-out trials, as gains count it; None: nothing held out."""
    pairs = [(t, clean) for t, clean in zip(case.dataset.trials, case.clean, strict=True) if t.role == "held_out"]
    if not pairs:
        return None
    measured = np.concatenate([trial.velocity for trial, _ in pairs])
    noise = measured - np.concatenate([clean for _, clean in pairs])
    return float(np.mean(np.sqrt(np.mean(noise**2, axis=0)) / np.ptp(measured, axis=0)))


def _draw(task: Task) -> Case:
    return make_case(
        task.seed, task.kind, split=task.split, cause=task.cause, strength=task.strength, least=task.least,
        noise_kind=task.noise, disturbance=task.disturbance,
        rivals=task.kind == "one" and task.joints == PIKE, joints=task.joints,
    )  # fmt: skip


def _answer(folder: Path, task: Task) -> Path:
    return folder / "answer" / f"{task.name}.json"


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
        "candidates": [
            {key: one[key] for key in ("name", "score", "statistic", "rival_p", "fit_p", "error", "held_out_error")}
            for one in plain["candidates"]
            if one["applicable"]
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


def judged(folder: Path) -> list[Judged]:
    """Open the truths of all answers in a folder, each checked against its seal."""
    found = []
    for file in sorted((folder / "answer").glob("*.json")):
        truth = open_truth(folder / "truth" / file.name)[0]
        found.append(Judged(truth, json.loads(file.read_text(encoding="utf-8"))))
    return found


def sealed_answers(folder: Path) -> list[dict[str, Any]]:
    """Return, by case, the hash of its sealed truth and the answer in short; truths stay shut."""
    found = []
    for file in sorted((folder / "answer").glob("*.json")):
        answer = json.loads(file.read_text(encoding="utf-8"))
        beside = folder / "truth" / f"{file.name}.sha256"
        found.append(
            {
                "case": file.stem,
                "truth": beside.read_text(encoding="utf-8").split()[0],
                **{key: answer[key] for key in ("verdict", "message", "alternatives", "cpu")},
                "mechanisms": [
                    {key: one[key] for key in ("name", "level", "form", "forms")} for one in answer["mechanisms"]
                ],
            }
        )
    return found
