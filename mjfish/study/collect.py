"""A table and a summary of the pieces of a study that are done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjfish.effects import catalogue
from mjfish.errors import InputError
from mjfish.estimation.tables import write_rows
from mjfish.files.writing import write_text
from mjfish.study.cases import Case, Generated
from mjfish.study.pieces import Store

#: Files of a collection.
TABLE, SUMMARY = "study.csv", "summary.txt"


@dataclass(frozen=True)
class Collected:
    """What was collected.

    Attributes:
        rows: of the table, a piece each.
        summary: a line a dataset and setting.
        missing: pieces that are not done, or whose file is damaged.
        files: that were written.
    """

    rows: tuple[dict[str, Any], ...]
    summary: str
    missing: int
    files: tuple[Path, ...]


def collect(cases: Sequence[Case], out: Path) -> Collected:
    """Write a CSV table, a row a piece, and a summary of the pieces of a study that are done in a folder.

    Args:
        cases: all pieces of the study.
        out: their folder.

    Raises:
        InputError: none of them is done; the folder cannot be written.
    """
    store = Store(out)
    rows: list[dict[str, Any]] = []
    for case in cases:
        try:
            content = store.read(case.key)
        except InputError:
            content = None
        if content is not None:
            rows.append(_row(case, content, store.seconds(case.key)))
    if not rows:
        raise InputError(f"{out}: holds no piece of this study that is done; run the study into this folder first")
    names = dict.fromkeys(name for row in rows for name in row)
    text = "\n".join(_summary(cases, rows)) + "\n"
    files = (out / TABLE, out / SUMMARY)
    write_rows(files[0], [{name: row.get(name) for name in names} for row in rows])
    write_text(files[1], text)
    return Collected(tuple(rows), text, len(cases) - len(rows), files)


def _row(case: Case, content: dict[str, Any], seconds: float | None) -> dict[str, Any]:
    """Return the row of a piece: what was done, what came of it, and the estimates."""
    result = content.get("result", {})
    found = result.get("verdict", result.get("status", content["outcome"]))
    generated = case.dataset if isinstance(case.dataset, Generated) else None
    row = {
        "dataset": case.dataset.name,
        "setting": case.setting.name,
        "seed": case.seed,
        "outcome": found,
        "reason": content.get("reason", result.get("message")),
        "causes": ", ".join(cause["name"] for cause in result.get("causes", ())),
        "true_causes": None if generated is None else ", ".join(generated.effects),
        "right": _right(result, generated) if generated is not None and "verdict" in result else None,
        "seconds": seconds,
        "piece": case.key,
    }
    estimates = result.get("parameters", {})
    truth = case.truth() if estimates else {}
    for name, value in estimates.items():
        row.update({name: value["estimate"], f"{name} low": value["low"], f"{name} high": value["high"]})
        if name in truth:
            row[f"{name} true"] = truth[name]
    return row


def _right(result: dict[str, Any], generated: Generated) -> str:
    """Return ``yes``, ``no``, or ``open`` where the mechanisms that act are among those that cannot be told apart."""
    truth = _mechanisms(generated.effects)
    if result["verdict"] == "cannot_tell":
        return "open" if truth in map(_mechanisms, result["alternatives"]) else "no"
    if result["verdict"] == "unexplained":
        return "no"
    return "yes" if {one["name"] for one in result["mechanisms"]} == truth else "no"


def _mechanisms(causes: Iterable[str]) -> set[str]:
    known = catalogue()
    return {known[name].mechanism if name in known else name for name in causes}


def _summary(cases: Sequence[Case], rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for all, then one for each dataset and setting."""
    failed = sum(row["outcome"] == "failed" for row in rows)
    lines = [f"{len(rows)} of {len(cases)} pieces are done, {failed} of them failed."]
    for dataset, setting in dict.fromkeys((case.dataset.name, case.setting.name) for case in cases):
        own = [row for row in rows if (row["dataset"], row["setting"]) == (dataset, setting)]
        outcomes = Counter(str(row["outcome"]) for row in own)
        right = Counter(row["right"] for row in own if row["right"] is not None)
        said = [f"{count} {name}" for name, count in outcomes.most_common()] or ["none done"]
        if right:
            said.append(f"right: {right['yes']} yes, {right['no']} no, {right['open']} open")
        known = [row["seconds"] for row in own if row["seconds"] is not None]
        if known:
            said.append(f"{sum(known) / len(known):.1f} s a piece")
        lines.append(f"{dataset}, {setting}: {'; '.join(said)}")
    return lines
