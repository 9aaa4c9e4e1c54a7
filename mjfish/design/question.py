"""What the next experiment is to answer: which rivals to tell apart, or which causes to make visible."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mjfish.errors import InputError

Purpose = Literal["separate", "see"]


@dataclass(frozen=True)
class Question:
    """What the next experiment is to answer.

    Attributes:
        purpose: ``separate`` rivals, or ``see`` causes that the data do not show.
        names: of the causes; empty with ``see``: all that apply.
        why: in a sentence.
        starts: sizes of the causes by full parameter name where a diagnosis estimated them.
    """

    purpose: Purpose
    names: tuple[str, ...]
    why: str = ""
    starts: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse rivals that are fewer than two or there twice."""
        if len(set(self.names)) < len(self.names):
            raise InputError(f"causes {', '.join(self.names)}: one is there twice; give each once")
        if self.purpose == "separate" and len(self.names) < 2:
            raise InputError(f"rivals: found {', '.join(self.names) or 'none'}, expected two or more; name another")


def of_diagnosis(raw: Mapping[str, Any], causes: Sequence[str] = ()) -> Question:
    """Return what a diagnosis leaves open.

    Rivals, where it cannot tell; what was named, or came closest, against the runner-up; where nothing is wrong, or
    only one cause was tried, which causes more data would show.

    Args:
        raw: of `mjfish.diagnosis.Diagnosis.to_dict`.
        causes: that are to be made visible where nothing is wrong; empty: all.
    """
    tried = [c for c in raw["candidates"] if c["applicable"] and c["parameters"]]
    starts = {f"{c['name']}.{short}": p["estimate"] for c in tried for short, p in c["parameters"].items()}
    ranked = [c["name"] for c in sorted(tried, key=lambda c: -c["statistic"])]
    verdict = raw["verdict"]
    if verdict == "nothing_wrong" or len(ranked) < 2:
        return Question("see", tuple(causes), "Nothing wrong was found: the plan makes smaller effects visible.")
    group = tuple(str(name) for name in next(iter(raw["rivals"]), ()))
    if verdict == "cannot_tell" and len(group) > 1:
        return Question("separate", group, f"The data cannot tell {' or '.join(group)} apart.", starts)
    named = [cause["name"] for cause in raw["causes"]]
    first = named[0] if named else ranked[0]
    second = next(name for name in ranked if name != first)
    what = f"{first} was named" if named else f"no cause explains the data; {first} comes closest"
    return Question("separate", (first, second), f"Verdict {verdict}: {what}, {second} is the runner-up.", starts)


def of_file(path: Path, dataset: str, causes: Sequence[str] = ()) -> Question:
    """Return what the diagnosis in ``diagnosis.json`` leaves open.

    Raises:
        InputError: the file cannot be read, is no diagnosis, or is one of another dataset than `dataset`.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        told = raw["dataset"]
        question = of_diagnosis(raw, causes)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; write it by 'mjfish diagnose DATASET --json {path}'") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read as JSON: {error}; write it by 'mjfish diagnose --json'") from None
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: is no diagnosis: {error} is missing or wrong; write it by 'mjfish diagnose'"
        ) from None
    if told != dataset:
        raise InputError(
            f"{path}: is the diagnosis of '{told}', expected that of '{dataset}'; give the one that belongs"
        )
    return question
