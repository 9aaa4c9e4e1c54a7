"""Projection of columns: an orthonormal basis of their span, and what is left beside it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mjfish.arrays import FloatArray

#: Directions weaker than this share of the strongest are numerical dust.
_RANK = 1e-9


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, rank) of the span of `columns` (n, k), each first scaled to length 1."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 1e-300] / lengths[lengths > 1e-300]
    if kept.shape[1] == 0:
        return np.zeros((len(columns), 0))
    left, singular, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(left[:, singular > _RANK * singular[0]])


def project_out(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return `columns` less their part in the span of the orthonormal `basis`."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def blocks_of(sizes: Sequence[int]) -> list[slice]:
    """Return the slices of consecutive blocks of columns."""
    ends = np.cumsum([0, *sizes])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
