"""Truths, written before any diagnosis and opened after: JSON in one file, its SHA-256 in another."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mjfish.errors import InputError


@dataclass(frozen=True)
class Truth:
    """What is hidden in one case.

    Attributes:
        seed, split: the case was drawn from.
        kind: ``none``, ``one``, ``two``, ``three``, ``off_list``, ``decoy``, ``foreign`` or
            ``foreign_pair``.
        causes: names, in the order drawn.
        psi: all parameters of the effects, by the generator's names (those of the solver where `exact`).
        exact: by cause, whether the solver's definition is the generator's.
        theta: the nine coefficients.
        strength: by cause, lambda over the fitted runs: after refit, given the other causes; of ``foreign``,
            beyond the basis of any one rival mechanism, too.
        strength_all: of a single cause, the same where the held-out runs are fitted too.
        reached: by cause, whether the strength asked for was met within 5 per cent.
        absorbed: by cause, the share of its signature that the refit swallows.
        rho: by cause, correlation after refit with every other cause of the list; empty where not asked for.
        n: numbers measured in the fitted runs.
        noise: kind and numbers of the noise; `stated`: whether the dataset states its sigma.
        disturbance: kind and size of the force noise; empty where none.
        pose, roll: whether they are recorded.
        runs: names of the fitted, names of the held out.
    """

    seed: int
    split: str
    kind: str
    causes: tuple[str, ...]
    psi: Mapping[str, float]
    exact: Mapping[str, bool]
    theta: Mapping[str, float]
    strength: Mapping[str, float]
    strength_all: Mapping[str, float]
    reached: Mapping[str, bool]
    absorbed: Mapping[str, float]
    n: int
    noise: Mapping[str, Any]
    stated: bool
    disturbance: Mapping[str, Any]
    pose: bool
    roll: bool
    runs: tuple[tuple[str, ...], tuple[str, ...]]
    rho: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def rho_max(self) -> dict[str, float]:
        """Largest correlation of each cause with another one of the list."""
        return {cause: max(own.values(), default=0.0) for cause, own in self.rho.items()}


def seal(truths: Sequence[Truth], path: str | Path) -> str:
    """Write truths to a JSON file and their SHA-256 beside it (``.sha256``); return the hash."""
    path = Path(path)
    text = json.dumps([dataclasses.asdict(truth) for truth in truths], indent=1, sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()
    for target, content in ((path, text), (_beside(path), f"{digest}  {path.name}\n")):
        partial = target.with_name(f".{target.name}.partial")
        partial.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(content, encoding="utf-8")
        partial.replace(target)
    return digest


def open_truth(path: str | Path, digest: str | None = None) -> tuple[Truth, ...]:
    """Read truths back, having checked them against `digest`, or against the hash beside the file.

    Raises:
        InputError: a file is absent, or the truths are not those that were sealed.
    """
    path = Path(path)
    for file in (path, _beside(path)):
        if not file.is_file() and (file == path or digest is None):
            raise InputError(f"{file}: no such file, expected sealed truths and their hash; correct the path")
    text = path.read_text(encoding="utf-8")
    found = hashlib.sha256(text.encode()).hexdigest()
    expected = _beside(path).read_text(encoding="utf-8").split()[0] if digest is None else digest
    if found != expected:
        raise InputError(
            f"{path}: has the hash {found[:12]}, expected {expected[:12]}; it was changed after the sealing"
        )
    return tuple(_truth(entry) for entry in json.loads(text))


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


def _truth(entry: dict[str, Any]) -> Truth:
    fitted, held = entry.pop("runs")
    return Truth(**{**entry, "causes": tuple(entry["causes"]), "runs": (tuple(fitted), tuple(held))})
