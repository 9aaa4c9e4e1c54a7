"""Weak directions in words: what the data cannot tell apart, and what nothing in the data moves.

With columns of the Jacobian scaled to length 1, a singular value s of them ([Belsley1980]) is small where a combination
of parameters moves the prediction hardly at all; 1 / s is how much wider that makes a standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjfish.estimation.fit import Fit
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

#: Estimates that are correlated beyond this are named as a pair.
CORRELATED = 0.95
#: A direction with a smaller singular value is weak.
WEAK = 0.15
#: Estimates that are correlated beyond this, or open over this share of their bounds, cannot be told apart at all.
_LOST = 0.975
_OPEN = 0.25
#: Smallest share of a weak direction, of its largest one, that makes a parameter a member of it.
_MEMBER = 0.3

Kind = Literal["unmoved", "faint", "pair", "combination"]


@dataclass(frozen=True)
class Weakness:
    """Something that the data do not say.

    Attributes:
        kind: ``unmoved``: nothing in the data depends on it; ``faint``: less than the noise over its whole range;
            ``pair``: two that are hard to tell apart; ``combination``: more than two, of which one combination is not
            seen.
        parameters: concerned, the strongest member first.
        changes: of each, the others held, that together add 1 to the sum of squares; empty where one is concerned.
        correlation: of the estimates of a pair; None of others.
        text: the same in words.
    """

    kind: Kind
    parameters: tuple[str, ...]
    changes: tuple[float, ...]
    correlation: float | None
    text: str


def weaknesses(fit: Fit) -> tuple[Weakness, ...]:
    """Return what the data of a fit do not say about the parameters that are off their bounds; clearest first.

    The noise is taken to be as large as the residual where that is more than stated.
    """
    noise = max(1.0, float(np.sqrt(fit.sse / max(fit.count - len(fit.x), 1))))
    triangle = fit.jacobian.factorised().triangle.dense() / noise
    length = np.linalg.norm(triangle, axis=0)
    off = [k for k in range(len(fit.x)) if not fit.at_bound[k]]
    alone = [_alone(fit.parameters[k], float(length[k])) for k in off]
    seen = [k for k, weakness in zip(off, alone, strict=True) if weakness is None]
    parameters = tuple(fit.parameters[k] for k in seen)
    together = _directions(parameters, triangle[:, seen], length[seen]) if len(seen) > 1 else []
    return tuple(weakness for weakness in alone if weakness is not None) + tuple(together)


def _alone(p: Parameter, length: float) -> Weakness | None:
    """Return whether a parameter, all others known, moves the whitened prediction by less than 1 over its range."""
    reach = length * (p.high - p.low)
    if reach >= 1.0:
        return None
    if length * p.scale < 1e-9:
        text = f"nothing in these data moves {p.name}: fix it, or record swimming that depends on it"
        return Weakness("unmoved", (p.name,), (), None, text)
    text = (
        f"{p.name} is not seen on these data: from {p.low:g} to {p.high:g} {p.unit}, all of its range, the prediction "
        f"changes by {reach:.2g} of the noise; fix it"
    )
    return Weakness("faint", (p.name,), (), None, text)


def _directions(parameters: tuple[Parameter, ...], triangle: FloatArray, length: FloatArray) -> list[Weakness]:
    """Return weak combinations, weakest first, then pairs that are correlated and in none of them."""
    _, singular, right = np.linalg.svd(triangle / length, full_matrices=False)
    floored = np.maximum(singular, 1e-10)
    spread = (right.T / floored**2) @ right
    errors = np.sqrt(np.diag(spread))
    correlation = spread / np.outer(errors, errors)
    found: list[Weakness] = []
    for s, direction in sorted(zip(floored, right, strict=True), key=lambda pair: float(pair[0])):
        order = np.argsort(-np.abs(direction))
        members = [k for k in order if abs(direction[k]) > _MEMBER * abs(direction[order[0]])]
        chosen = [parameters[k] for k in members]
        if s >= WEAK or len(members) < 2 or _known({p.name for p in chosen}, found):
            continue
        changes, r = _weakest(triangle[:, members]), float(correlation[members[0], members[1]])
        found.append(_combination(chosen, changes) if len(members) > 2 else _pair(chosen, changes, r))
    pairs = [
        _pair([second, first], _weakest(triangle[:, [j, i]]), r)
        for i, first in enumerate(parameters)
        for j, second in enumerate(parameters[:i])
        if abs(r := float(correlation[i, j])) > CORRELATED and not _known({first.name, second.name}, found)
    ]
    return [*found, *sorted(pairs, key=lambda pair: -abs(pair.correlation or 0.0))]


def _weakest(columns: FloatArray) -> FloatArray:
    """Return the changes (k,) that together move the prediction by 1 and are the longest, in units of each alone."""
    length = np.linalg.norm(columns, axis=0)
    _, singular, right = np.linalg.svd(columns / length, full_matrices=False)
    return np.asarray(right[-1] * np.sign(right[-1, 0]) / max(singular[-1], 1e-10) / length)


def _known(names: set[str], found: list[Weakness]) -> bool:
    """Return whether one weakness in `found` has all these names."""
    return any(names <= set(weakness.parameters) for weakness in found)


def _open(parameters: list[Parameter], changes: FloatArray) -> bool:
    """Return whether two standard errors of a direction are more than `_OPEN` of the range of a member."""
    return any(2.0 * abs(c) / (p.high - p.low) > _OPEN for p, c in zip(parameters, changes.tolist(), strict=True))


def _pair(parameters: list[Parameter], changes: FloatArray, correlation: float) -> Weakness:
    first, second = (p.name for p in parameters)
    lost = abs(correlation) > _LOST or _open(parameters, changes)
    digits = int(np.clip(np.ceil(-np.log10(max(1.0 - abs(correlation), 1e-12))), 2, 6))
    return Weakness(
        "pair",
        (first, second),
        tuple(changes.tolist()),
        correlation,
        f"{first} and {second} {'cannot be told' if lost else 'are hard to tell'} apart on these data: "
        f"correlation {correlation:.{digits}f}",
    )


def _combination(parameters: list[Parameter], changes: FloatArray) -> Weakness:
    names = [p.name for p in parameters]
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    lost = _open(parameters, changes)
    head = f"only a combination of {listed} is seen" if lost else f"{listed} are hard to tell apart"
    moves = [f"{name} by {change:+.2g}" for name, change in zip(names, changes, strict=True)]
    return Weakness(
        "combination",
        tuple(names),
        tuple(changes.tolist()),
        None,
        f"{head} on these data: {', '.join(moves[:-1])} and {moves[-1]} together change no more than the noise does",
    )
