"""A description of the missing force where no cause of the catalogue fits: terms of the link velocities.

It tells the reader what the force looks like, not what causes it; no verdict rests on it.

[Pati1993] Y. Pati, R. Rezaiifar, P. Krishnaprasad, 27th Asilomar Conference.
[Shah2013] R. Shah, R. Samworth, Variable selection with error control: another look at stability selection, J. R.
Statist. Soc. B 75.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.effects.effect import Effect, variant
from mjfish.estimation import Fit, Problem
from mjfish.hydro.load import Load, load
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged
from mjfish.parameters import Parameter

#: Functions of a link's velocity, surge u, sway v, yaw w; named as a reader would write them.
_FUNCTIONS = ("1", "u", "|u| u", "v", "|v| v", "w", "u v")
_MOST = 3
_PAIRS, _OFTEN = 25, 0.7


@merged
def _total(link: Any, p: Any) -> Any:
    """Return the sum of all functions of a link's velocity."""
    u, v, w = link.u, link.v, link.w
    return p[0] + p[1] * u + p[2] * abs(u) * u + p[3] * v + p[4] * abs(v) * v + p[5] * w + p[6] * u * v


@load
def _surge_load(link: Any, p: Any) -> tuple[float, float, float]:
    return _total(link, p) * link.length, 0.0, 0.0


@load
def _sway_load(link: Any, p: Any) -> tuple[float, float, float]:
    total = _total(link, p)
    return 0.0, total * link.length, 0.5 * total * link.length**2


@load
def _yaw_load(link: Any, p: Any) -> tuple[float, float, float]:
    return 0.0, 0.0, _total(link, p) * link.length


class _Term(Effect):
    """Forces on every link per length; not in the catalogue, for it names no cause."""

    domain = "water"
    source = "a description, not a physics"
    signature = "that of its terms"
    confirm = "find the cause"


def _term(name: str, summary: str, of: Load) -> Effect:
    declared = tuple(
        Parameter(f"{name}.term_{k}", "SI", 0.0, -1e6, 1e6, 0.0, 0.1, about=function)
        for k, function in enumerate(_FUNCTIONS)
    )
    return variant(_Term, name=name, summary=summary, parameters=declared, load=of)


_TERMS = (
    _term("force_along", "a force along every link", _surge_load),
    _term("force_across", "a force across every link", _sway_load),
    _term("moment", "a moment on every link", _yaw_load),
)


@dataclass(frozen=True)
class Term:
    """One term of a description.

    Attributes:
        what: in words, e.g. ``a force along every link ~ |u| u``.
        size: amplitude, SI units per metre of link.
        stable: share of the halves of the runs that choose it too.
    """

    what: str
    size: float
    stable: float


@dataclass(frozen=True)
class Description:
    """Terms that describe the missing force, and the share of all there is to explain that they explain."""

    terms: tuple[Term, ...]
    explained: float


def describe(problem: Problem, fit: Fit) -> Description:
    """Describe what a fit leaves by forces on every link, such as "a moment on every link ~ |u| u".

    The signature of such a term is a sensitivity like that of a cause: no noisy signal is differentiated, and the
    coefficients are projected out. Terms are chosen by orthogonal matching pursuit [Pati1993] and kept where most
    random halves of the runs choose them too (stability selection by complementary pairs, [Shah2013]). The result says
    how the missing force looks, not why.
    """
    evidence = gather(problem, fit, _TERMS)
    labels = [f"{effect.summary} ~ {p.about}" for effect in evidence.candidates for p in effect.parameters]
    scales = np.array([p.scale for effect in evidence.candidates for p in effect.parameters])
    chosen = _pursuit(evidence.score, evidence.information)
    halves = _halves(evidence)
    often = [np.mean([index in half for half in halves]) for index in chosen]
    kept = [index for index, share in zip(chosen, often, strict=True) if share >= _OFTEN]
    if not kept:
        return Description((), 0.0)
    size = np.linalg.solve(evidence.information[np.ix_(kept, kept)], evidence.score[kept])
    explained = float(size @ evidence.score[kept]) - len(kept)
    total = explained + max(_remaining_beyond_chance(evidence, kept), 0.0)
    terms = [
        Term(labels[i], float(s * scales[i]), float(often[chosen.index(i)])) for i, s in zip(kept, size, strict=True)
    ]
    return Description(tuple(terms), max(explained, 0.0) / max(total, 1e-9))


def _remaining_beyond_chance(evidence: Evidence, kept: Sequence[int]) -> float:
    """Return what the omnibus basis explains beyond chance of what the terms leave."""
    statistic, rank = evidence.omnibus
    size = np.linalg.solve(evidence.information[np.ix_(kept, kept)], evidence.score[list(kept)])
    return statistic - rank - float(size @ evidence.score[list(kept)])


def _pursuit(score: FloatArray, information: FloatArray) -> list[int]:
    """Choose columns one by one, each the one that explains most of what those before it leave."""
    lengths = np.sqrt(np.maximum(np.diag(information), 1e-300))
    solid = lengths > 1e-9 * lengths.max()
    chosen: list[int] = []
    for _ in range(_MOST):
        inner = information[np.ix_(chosen, chosen)]
        weights = np.linalg.lstsq(inner, score[chosen])[0] if chosen else np.zeros(0)
        left = score - information[:, chosen] @ weights
        across = np.linalg.lstsq(inner, information[chosen])[0] if chosen else np.zeros((0, len(score)))
        own = np.diag(information) - np.einsum("ij,ij->j", information[chosen], across)
        gain = np.where(solid & (own > 1e-6 * lengths**2), left**2 / np.maximum(own, 1e-300), 0.0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        if gain[best] < 2.0 * np.log(len(score)) + 4.0:
            break
        chosen.append(best)
    return chosen


def _halves(evidence: Evidence) -> list[list[int]]:
    """Choose terms again on random complementary halves of the runs."""
    rows = evidence.problem.trial_rows
    if len(rows) < 2:
        return [_pursuit(evidence.score, evidence.information)]
    z = evidence.cleared
    signatures = evidence.signatures
    scores = [signatures[r].T @ z[r] for r in rows]
    informations = [signatures[r].T @ signatures[r] for r in rows]
    chosen = []
    for _ in range(_PAIRS):
        order = np.random.default_rng(0).permutation(len(rows))
        for half in (order[: len(rows) // 2], order[len(rows) // 2 :]):
            chosen.append(_pursuit(sum(scores[i] for i in half), sum(informations[i] for i in half)))
    return chosen
