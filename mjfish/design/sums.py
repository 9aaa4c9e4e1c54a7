"""Sums of squares and products over runs: what is known of parameters, and of a difference that they may explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.estimation import Problem

#: Directions below this share of the strongest are numerical dust.
_RANK = 1e-10


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over runs of the columns of J and of a difference d, all in units of the noise.

    Attributes:
        names: of the columns of J, which are in units of the parameters' scales; see `column`.
        gram: J'J (p, p).
        moment: J'd (p,).
        square: d'd.
    """

    names: tuple[str, ...]
    gram: FloatArray
    moment: FloatArray
    square: float

    def __add__(self, other: Sums) -> Sums:
        """Join runs; columns of the same name are the same parameter."""
        names = (*self.names, *(name for name in other.names if name not in self.names))
        gram, moment = np.zeros((len(names), len(names))), np.zeros(len(names))
        for part in (self, other):
            at = [names.index(name) for name in part.names]
            gram[np.ix_(at, at)] += part.gram
            moment[at] += part.moment
        return Sums(names, gram, moment, self.square + other.square)

    def of(self, rival: str) -> Sums:
        """Return the sums of the columns that are named after a rival."""
        at = [i for i, name in enumerate(self.names) if name.startswith(column(rival, ""))]
        return Sums(tuple(self.names[i] for i in at), self.gram[np.ix_(at, at)], self.moment[at], self.square)

    @property
    def apart(self) -> float:
        """Return d'd - d'J (J'J)^+ J'd: what of d is left after a refit."""
        explained = self.moment @ solve(self.gram, self.moment[:, None])[:, 0]
        return max(self.square - float(explained), 0.0)


def column(rival: str, parameter: str) -> str:
    """Return the name of a column where two rivals have a parameter each of the same name."""
    return f"{rival}/{parameter}"


def solve(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return gram^+ right (p, k) of a positive semi-definite gram, its columns first scaled to length 1."""
    length = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = values > _RANK * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, dtype=bool)
    inner = vectors[:, kept].T @ (right / length[:, None])
    return np.asarray(vectors[:, kept] @ (inner / values[kept, None]) / length[:, None])


def gram_of(problem: Problem, i: int, block: FloatArray) -> FloatArray:
    """Return B'B (k, k) of the whitened columns of a block (n_i, 3, k) of the counted samples of trial i."""
    white = problem.whitened(i, block)
    white = white.reshape(-1, white.shape[2])
    return np.asarray(white.T @ white)
