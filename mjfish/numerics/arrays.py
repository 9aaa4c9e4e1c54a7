"""Array types, read-only arrays, the projection of columns on a span and beside it, and normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
RecordArray = NDArray[Any]


#: Standard deviation of normal errors over the median of their absolute values.
_MEDIAN = 1.4826


def robust_sigma(errors: FloatArray) -> FloatArray:
    """Return the standard deviation (...) of errors (n, ...) about zero by 1.4826 median |e|, whatever a few are."""
    return np.asarray(_MEDIAN * np.median(np.abs(errors), axis=0))


def readonly(values: ArrayLike) -> FloatArray:
    """Return a contiguous float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def checked(found: NDArray[np.floating[Any]]) -> FloatArray:
    """Return what a solver found; refuse NaN, of which every comparison is false, so that it would pass for nothing.

    Raises:
        LinAlgError: a number is none.
    """
    if np.isnan(found).any():
        raise np.linalg.LinAlgError("a solver found what is no number")
    return np.asarray(found, dtype=np.float64)


#: Directions weaker than this share of the strongest are numerical dust.
RANK = 1e-9


def orthonormal(columns: FloatArray, least: float = RANK) -> FloatArray:
    """Return an orthonormal basis (n, rank) of the span of `columns` (n, k), each first scaled to length 1.

    Directions weaker than the share `least` of the strongest are left out.
    """
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 1e-300] / lengths[lengths > 1e-300]
    if kept.shape[1] == 0:
        return np.zeros((len(columns), 0))
    left, singular, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(left[:, checked(singular) > least * singular[0]])


def project_out(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return `columns` less their part in the span of the orthonormal `basis`."""
    return np.asarray(columns - basis @ (basis.T @ columns))


#: Eigenvalues of a matrix of scaled columns below this share of the largest are rounding.
_DUST = 1e-10
#: Columns whose square is below this share of the largest are rounding.
_NOTHING = 1e-26


def solve(gram: FloatArray, right: FloatArray, rank: float = _DUST) -> FloatArray:
    """Return gram^+ right (p, k) of a positive semi-definite matrix, its columns first scaled to length 1.

    Eigenvalues below the share `rank` of the largest count as zero, and so do columns that are nothing but rounding.
    """
    square = np.diag(gram)
    length = np.where(square > _NOTHING * square.max(initial=1e-300), np.sqrt(np.maximum(square, 1e-300)), np.inf)
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = checked(values) > rank * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, dtype=bool)
    inner = vectors[:, kept].T @ (right / length[:, None])
    return np.asarray(vectors[:, kept] @ (inner / values[kept, None]) / length[:, None])


def principal_axes(gram: FloatArray) -> FloatArray:
    """Return W (k, rank) by which the columns S of gram = S'S become orthonormal, S W.

    Columns are scaled to length 1 first; directions of which hardly anything is left are rounding, and left out.
    """
    lengths = np.sqrt(np.maximum(np.diag(gram), 0.0))
    kept = lengths > 1e-9 * lengths.max(initial=1e-300)
    scaled = gram[np.ix_(kept, kept)] / np.outer(lengths[kept], lengths[kept])
    values, vectors = np.linalg.eigh(scaled)
    solid = checked(values) > 1e-7
    axes = np.zeros((len(gram), int(np.count_nonzero(solid))))
    axes[kept] = vectors[:, solid] / np.sqrt(values[solid]) / lengths[kept, None]
    return axes


def blocks_of(sizes: Sequence[int]) -> list[slice]:
    """Return the slices of consecutive blocks of columns."""
    return [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([0, *sizes]))]
