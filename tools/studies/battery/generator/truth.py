"""Truths, drawn and hashed before any diagnosis and opened after."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


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

    @property
    def seal(self) -> str:
        """SHA-256 of the truth, to be published before it is opened."""
        text = json.dumps([dataclasses.asdict(self)], indent=1, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @staticmethod
    def of(entry: Mapping[str, Any]) -> Truth:
        """Return the truth of its plain data."""
        fitted, held = entry["runs"]
        return Truth(**{**entry, "causes": tuple(entry["causes"]), "runs": (tuple(fitted), tuple(held))})
