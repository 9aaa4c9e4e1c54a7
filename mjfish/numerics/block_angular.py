"""Matrices of all runs' rows in which some columns belong to one run: block angular form, and the span of the columns.

The derivative of all residuals has columns of parameters that runs share, S, and of single runs, B_r: a start, a clock.
The latter are zero but in the rows of their run.

    J = [ B_1            S_1 ]
        [      ...       ... ]        J x = sum_r B_r x_r + S x_s
        [           B_R  S_R ]

Kept in this form J takes memory in proportion to the number of runs, and so does the time of its orthogonal
factorisation [Golub1980]: each B_r = Q_r R_r is eliminated in the rows of its run, and what is left of S is factorised.

    J = Q [ R_1        T_1 ]       T_r = Q_r' S_r
          [     ...    ... ]       S_r - Q_r T_r = Q_s R_s  (all runs' rows)
          [       R_R  T_R ]
          [            R_s ]

No normal equations are formed: what coefficients hide of a signature is found to full precision.

[Golub1980] G. Golub and R. Plemmons: Large-scale geodetic least-squares adjustment by dissection and orthogonal
decomposition, Linear Algebra and its Applications 34.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjfish.numerics.arrays import RANK, BoolArray, FloatArray, checked

IntArray = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Part:
    """The columns of one run.

    Attributes:
        rows: (m,) places of the run's rows in the matrix.
        columns: (k,) places of the columns in the matrix.
        block: (m, k) B_r.
    """

    rows: IntArray
    columns: IntArray
    block: FloatArray


@dataclass(frozen=True, eq=False)
class BlockAngular:
    """A matrix (n, p) of block angular form.

    Attributes:
        shared: (n, s) S, columns that may be anything in all rows.
        places: (s,) places of these among all columns.
        parts: columns of single runs; no row is in two of them.

    Example:
        Two runs of two rows, a start value each and one coefficient.

        >>> import numpy as np
        >>> own = [Part(np.array([2 * r, 2 * r + 1]), np.array([r + 1]), np.array([[1.0], [0.5]])) for r in (0, 1)]
        >>> j = BlockAngular(np.arange(4.0)[:, None], np.array([0]), tuple(own))
        >>> print(j.dense())
        [[0.  1.  0. ]
         [1.  0.5 0. ]
         [2.  0.  1. ]
         [3.  0.  0.5]]
        >>> j @ np.ones(3)
        array([1. , 1.5, 3. , 3.5])
    """

    shared: FloatArray
    places: IntArray
    parts: tuple[Part, ...] = ()

    @classmethod
    def of(cls, columns: FloatArray) -> BlockAngular:
        """Return the matrix with columns (n, p) that runs share."""
        return cls(columns, np.arange(columns.shape[1]))

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns."""
        return len(self.shared), len(self.places) + sum(int(part.columns.size) for part in self.parts)

    @property
    def nbytes(self) -> int:
        """Bytes of its numbers."""
        return self.shared.nbytes + sum(part.rows.nbytes + part.block.nbytes for part in self.parts)

    def dense(self) -> FloatArray:
        """Return the matrix (n, p) with its zeros."""
        return self.of_rows(np.arange(len(self.shared)))

    def of_rows(self, rows: IntArray | slice) -> FloatArray:
        """Return some rows (m, p) with their zeros."""
        at = np.arange(len(self.shared))[rows]
        found = np.zeros((len(at), self.shape[1]))
        found[:, self.places] = self.shared[at]
        place = np.full(len(self.shared), -1)
        place[at] = np.arange(len(at))
        for part in self.parts:
            here = place[part.rows]
            found[np.ix_(here[here >= 0], part.columns)] = part.block[here >= 0]
        return found

    def of_columns(self, columns: Sequence[int]) -> FloatArray:
        """Return some columns (n, k) with their zeros."""
        return self @ np.eye(self.shape[1])[:, list(columns)]

    @cached_property
    def _run_of(self) -> IntArray:
        return _owners([part.rows for part in self.parts], len(self.shared))

    def at(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return some rows of one run: its own columns (m, k), the shared ones (m, s)."""
        run = int(self._run_of[rows[0]]) if len(rows) else -1
        own = self.parts[run].block[np.searchsorted(self.parts[run].rows, rows)] if run >= 0 else self.shared[rows, :0]
        return own, self.shared[rows]

    def __matmul__(self, x: FloatArray) -> FloatArray:
        """Return J x (n, ...) of x (p, ...)."""
        result = self.shared @ x[self.places]
        for part in self.parts:
            result[part.rows] += part.block @ x[part.columns]
        return np.asarray(result)

    def transposed_times(self, y: FloatArray) -> FloatArray:
        """Return J' y (p, ...) of y (n, ...)."""
        result = np.zeros((self.shape[1], *y.shape[1:]))
        result[self.places] = self.shared.T @ y
        for part in self.parts:
            result[part.columns] = part.block.T @ y[part.rows]
        return result

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths (p,) of the columns."""
        result = np.zeros(self.shape[1])
        result[self.places] = np.linalg.norm(self.shared, axis=0)
        for part in self.parts:
            result[part.columns] = np.linalg.norm(part.block, axis=0)
        return result

    def chosen(self, which: BoolArray) -> BlockAngular:
        """Return the matrix of some columns, `which` (p,)."""
        place = np.cumsum(which) - 1
        parts = []
        for part in self.parts:
            kept = which[part.columns]
            if np.any(kept):
                parts.append(Part(part.rows, place[part.columns[kept]], part.block[:, kept]))
        kept = which[self.places]
        return BlockAngular(self.shared[:, kept], place[self.places[kept]], tuple(parts))

    def scaled(self, rows: FloatArray | None = None, columns: FloatArray | None = None) -> BlockAngular:
        """Return the matrix with its rows times `rows` (n,), its columns times `columns` (p,)."""
        r = np.ones(len(self.shared)) if rows is None else rows
        c = np.ones(self.shape[1]) if columns is None else columns
        parts = (replace(p, block=r[p.rows, None] * p.block * c[p.columns]) for p in self.parts)
        return replace(self, shared=r[:, None] * self.shared * c[self.places], parts=tuple(parts))

    def above(self, rows: FloatArray) -> BlockAngular:
        """Return the matrix with more rows (m, p) below it; a row has numbers in the own columns of one run at most."""
        if not len(rows):
            return self
        parts, count = [], len(self.shared)
        for part in self.parts:
            own = np.flatnonzero(np.any(rows[:, part.columns] != 0.0, axis=1))
            parts.append(
                Part(
                    np.concatenate([part.rows, count + own]),
                    part.columns,
                    np.concatenate([part.block, rows[np.ix_(own, part.columns)]]),
                )
            )
        return BlockAngular(np.concatenate([self.shared, rows[:, self.places]]), self.places, tuple(parts))

    def top(self, count: int) -> BlockAngular:
        """Return the matrix of its first `count` rows."""
        parts = []
        for part in self.parts:
            kept = part.rows < count
            parts.append(Part(part.rows[kept], part.columns, part.block[kept]))
        return BlockAngular(self.shared[:count], self.places, tuple(parts))

    def beside(self, other: BlockAngular) -> BlockAngular:
        """Return the matrix with the columns of another one, of the same runs' rows, behind its own."""
        p = self.shape[1]
        held = {int(part.rows[0]): part for part in self.parts if len(part.rows)}
        for part in other.parts:
            mine = held.get(int(part.rows[0]))
            theirs = replace(part, columns=p + part.columns)
            held[int(part.rows[0])] = theirs if mine is None else _joined(mine, theirs)
        shared = (
            np.concatenate([self.shared, other.shared], axis=1)
            if other.shared.size
            else np.ascontiguousarray(self.shared)
        )
        return BlockAngular(shared, np.concatenate([self.places, p + other.places]), tuple(held.values()))

    def gram(self) -> FloatArray:
        """Return J'J (p, p)."""
        result = np.zeros((self.shape[1], self.shape[1]))
        result[np.ix_(self.places, self.places)] = self.shared.T @ self.shared
        for part in self.parts:
            mixed = part.block.T @ self.shared[part.rows]
            result[np.ix_(part.columns, part.columns)] = part.block.T @ part.block
            result[np.ix_(part.columns, self.places)] = mixed
            result[np.ix_(self.places, part.columns)] = mixed.T
        return result

    def solve(self, y: FloatArray, rank: float) -> FloatArray:
        """Return J^+ y (p,) of y (n,): singular values below the share `rank` of the largest count as zero."""
        return self.factors.solve(y, rank)

    def sparse(self, count: int) -> sparse.csr_array:
        """Return the matrix without its zeros, as one of `count` rows: nothing is in those behind its own."""
        pieces = [(np.arange(len(self.shared)), self.places, self.shared)]
        pieces += [(part.rows, part.columns, part.block) for part in self.parts]
        rows = np.concatenate([np.repeat(at, len(columns)) for at, columns, _ in pieces])
        places = np.concatenate([np.tile(columns, len(at)) for at, columns, _ in pieces])
        values = np.concatenate([block.ravel() for _, _, block in pieces])
        return sparse.csr_array((values, (rows, places)), shape=(count, self.shape[1]))

    def inverses(self, rank: float) -> tuple[list[Inverse], Inverse, float]:
        """Return the inverses of the diagonal blocks of a triangle, by run, of the shared one, and the least size.

        This is the share `rank` of the largest singular value of any.
        """
        own = [Inverse.of(part.block) for part in self.parts]
        shared = Inverse.of(self.shared[sum(len(part.rows) for part in self.parts) :])
        return own, shared, rank * max(1e-100, *(one.sizes.max(initial=0.0) for one in (shared, *own)))

    def inverse_gram(self, rank: float) -> FloatArray:
        """Return (R'R)^-1 (p, p) of a triangle; singular values below the share `rank` of the largest count as that."""
        own, shared, least = self.inverses(rank)
        root, moved = shared.floored(least)[0], np.zeros((self.shape[1], len(self.places)))
        moved[self.places] = np.eye(len(self.places))
        result = np.zeros((self.shape[1], self.shape[1]))
        for part, one in zip(self.parts, own, strict=True):
            alone, inverse = one.floored(least)
            result[np.ix_(part.columns, part.columns)] = alone @ alone.T
            moved[part.columns] = -inverse @ self.shared[part.rows]
        moved = moved @ root
        return np.asarray(result + moved @ moved.T)

    @cached_property
    def factors(self) -> Factors:
        """The factorisation J = Q R, kept as long as the matrix is: Q is as large."""
        return self.factorised()

    def factorised(self) -> Factors:
        """Return the factorisation J = Q R."""
        left, owns, tops, parts, count = self.shared.copy(), [], [], [], 0
        for part in self.parts:
            (q, r), mine = _run_factors(part.block), _slice_of(part.rows)
            tops.append(q.T @ left[mine])
            left[mine] -= q @ tops[-1]
            owns.append((part.rows, q))
            parts.append(Part(np.arange(count, count + len(r)), part.columns, r))
            count += len(r)
        q, r = np.linalg.qr(left)
        return Factors(Basis(tuple(owns), q), BlockAngular(np.concatenate([*tops, r]), self.places, tuple(parts)))


def block_angular(shared: FloatArray, rows: Sequence[IntArray], blocks: Sequence[FloatArray]) -> BlockAngular:
    """Return a matrix of shared columns (n, s), then blocks (m, k) of columns that single runs have in their rows."""
    ends = shared.shape[1] + np.cumsum([0, *(block.shape[1] for block in blocks)])
    parts = [
        Part(mine, np.arange(start, stop), block)
        for mine, block, start, stop in zip(rows, blocks, ends[:-1], ends[1:], strict=True)
        if stop > start
    ]
    return BlockAngular(shared, np.arange(shared.shape[1]), tuple(parts))


def _slice_of(rows: IntArray) -> slice | IntArray:
    """Return rows as a slice where they follow each other: it copies nothing."""
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) and np.all(np.diff(rows) == 1) else rows


def _owners(rows: Sequence[IntArray], count: int) -> IntArray:
    """Return which run (`count`,) has columns of its own in a row, by the rows of each; -1: none."""
    found = np.full(count, -1)
    for run, mine in enumerate(rows):
        found[mine] = run
    return found


def _joined(first: Part, second: Part) -> Part:
    """Return the columns of two parts of one run as one."""
    rows = np.union1d(first.rows, second.rows)
    block = np.zeros((len(rows), len(first.columns) + len(second.columns)))
    block[np.searchsorted(rows, first.rows), : len(first.columns)] = first.block
    block[np.searchsorted(rows, second.rows), len(first.columns) :] = second.block
    return Part(rows, np.concatenate([first.columns, second.columns]), block)


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal columns of block angular form.

    Attributes:
        per_run: rows (m,) and orthonormal columns (m, k) of single runs.
        shared: (n, s), orthonormal, and orthogonal to those.
    """

    per_run: tuple[tuple[IntArray, FloatArray], ...]
    shared: FloatArray

    @property
    def rank(self) -> int:
        """Number of columns."""
        return int(sum(q.shape[1] for _, q in self.per_run) + self.shared.shape[1])

    def coordinates(self, y: FloatArray) -> FloatArray:
        """Return Q' y (rank, ...) of y (n, ...): those of single runs first."""
        return np.concatenate([*(q.T @ y[rows] for rows, q in self.per_run), self.shared.T @ y])

    def off(self, y: FloatArray) -> FloatArray:
        """Return y (n, ...) less its part in the span."""
        left = y - self.shared @ (self.shared.T @ y)
        for rows, q in self.per_run:
            left[rows] -= q @ (q.T @ y[rows])
        return np.asarray(left)

    def off_at(self, rows: IntArray, y: FloatArray, coordinates: FloatArray) -> FloatArray:
        """Return some rows of one run of what `off` returns of y (n, ...), with its `coordinates`."""
        run, own, shared = self.at(rows)
        mine, common = coordinates[self.places_of(run)], coordinates[self.places_of(None)]
        return np.asarray(y[rows] - shared @ common - own @ mine)

    def explained(self, y: FloatArray) -> float:
        """Return |Q' y|^2 of y (n,)."""
        return float(np.sum(self.coordinates(y) ** 2))

    @cached_property
    def _run_of(self) -> IntArray:
        return _owners([rows for rows, _ in self.per_run], len(self.shared))

    def at(self, rows: IntArray) -> tuple[int, FloatArray, FloatArray]:
        """Return some rows of one run: which it is, its own columns (m, k), the shared ones (m, s)."""
        run = int(self._run_of[rows[0]]) if len(rows) else -1
        if run < 0:
            return run, np.zeros((len(rows), 0)), self.shared[rows]
        mine, q = self.per_run[run]
        return run, q[np.searchsorted(mine, rows)], self.shared[rows]

    def places_of(self, run: int | None) -> IntArray:
        """Return where the columns of a run stand, -1 has none; None: the shared ones."""
        ends = np.cumsum([0, *(q.shape[1] for _, q in self.per_run)])
        if run is None:
            return np.arange(ends[-1], self.rank)
        return np.arange(ends[run], ends[run + 1]) if run >= 0 else np.arange(0)

    def of_rows(self, rows: IntArray) -> FloatArray:
        """Return some rows (m, rank) with their zeros."""
        found = np.zeros((len(rows), self.rank))
        for k, row in enumerate(rows):
            run, own, shared = self.at(np.array([row]))
            found[k, self.places_of(run)], found[k, self.places_of(None)] = own[0], shared[0]
        return found

    def top(self, count: int) -> Basis:
        """Return the first `count` rows; the columns are no longer orthonormal."""
        own = tuple((rows[rows < count], q[rows < count]) for rows, q in self.per_run)
        return Basis(own, self.shared[:count])

    def leverage(self) -> FloatArray:
        """Return the squared lengths (n,) of the rows."""
        found = np.sum(self.shared**2, axis=1)
        for rows, q in self.per_run:
            found[rows] += np.sum(q**2, axis=1)
        return np.asarray(found)

    def square(self, other: Basis, weights: FloatArray) -> float:
        """Return |Q' diag(weights) P|^2, the sum of squares, of a basis P with the same runs."""
        total = np.sum(((self.shared * weights[:, None]).T @ other.shared) ** 2)
        for rows, q in self.per_run:
            _, own, shared = other.at(rows)
            weighed = (q * weights[rows, None]).T
            total += np.sum((weighed @ own) ** 2) + np.sum((weighed @ shared) ** 2)
        for rows, q in other.per_run:
            total += np.sum(((self.shared[rows] * weights[rows, None]).T @ q) ** 2)
        return float(total)


def _run_factors(block: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q (m, rank) and R (rank, k) of a run's own columns: shared ones lose nothing but what is in their span."""
    q, r = np.linalg.qr(block)
    pivots = np.abs(np.diag(r))
    if pivots.min(initial=np.inf) > RANK * pivots.max(initial=0.0):
        return q, r
    q, sizes, right = np.linalg.svd(block, full_matrices=False)
    kept = sizes > RANK * sizes.max(initial=0.0)
    return q[:, kept], sizes[kept, None] * right[kept]


@dataclass(frozen=True, eq=False)
class Factors:
    """A factorisation J = Q R.

    Attributes:
        basis: Q.
        triangle: (rank of Q, p) R: R'R = J'J, of block angular form, rows of single runs first.
    """

    basis: Basis
    triangle: BlockAngular

    def solve(self, y: FloatArray, rank: float) -> FloatArray:
        """Return J^+ y (p,) of y (n,): singular values below the share `rank` of the largest count as zero."""
        r, right = self.triangle, self.basis.coordinates(y)
        inverses, shared, least = r.inverses(rank)
        found = np.zeros(r.shape[1])
        count = len(r.shared) - len(shared.left)
        found[r.places] = shared.times(right[count:], least)
        right = right[:count] - r.shared[:count] @ found[r.places]
        for part, inverse in zip(r.parts, inverses, strict=True):
            found[part.columns] = inverse.times(right[part.rows], least)
        return found


@dataclass(frozen=True, eq=False)
class Inverse:
    """The inverse of a small matrix U diag(s) V'.

    Attributes:
        left: (m, r) U.
        sizes: (r,) s.
        right: (k, k) V'; rows behind the first r are directions that the matrix does not see.
    """

    left: FloatArray
    sizes: FloatArray
    right: FloatArray

    @classmethod
    def of(cls, block: FloatArray) -> Inverse:
        """Return the inverse of a matrix (m, k)."""
        left, sizes, right = np.linalg.svd(block)
        return cls(left[:, : len(sizes)], checked(sizes), right)

    def times(self, y: FloatArray, least: float) -> FloatArray:
        """Return the inverse times y (m,); singular values below `least` count as zero."""
        kept = np.flatnonzero(self.sizes > least)
        return np.asarray(self.right[kept].T @ ((self.left.T @ y)[kept] / self.sizes[kept]))

    def floored(self, least: float) -> tuple[FloatArray, FloatArray]:
        """Return V diag(1 / s) (k, k) and the inverse (k, m); singular values below `least` count as that."""
        sizes = np.concatenate([self.sizes, np.zeros(len(self.right) - len(self.sizes))])
        turned = self.right.T / np.maximum(sizes, least)
        return turned, turned[:, : len(self.sizes)] @ self.left.T


def span(columns: BlockAngular) -> Basis:
    """Return an orthonormal basis of the span of the columns, each first scaled to length 1.

    Directions below `mjfish.numerics.arrays.RANK` of the strongest are numerical dust: of a run's own columns, then of
    what these leave of the shared ones.
    """
    left = columns.shared * _scale(columns)[columns.places]
    return Basis(tuple(_run_bases(columns, left)), _leading(left, least=1.0))


def explained(columns: BlockAngular, y: FloatArray) -> tuple[float, int]:
    """Return |Q' y|^2 of y (n,) and the rank of Q, the `span` of the columns, of which the own part is not kept."""
    left, total, rank = columns.shared * _scale(columns)[columns.places], 0.0, 0
    for rows, q in _run_bases(columns, left):
        total += float(np.sum((q.T @ y[rows]) ** 2))
        rank += q.shape[1]
    q = _leading(left, least=1.0)
    return total + float(np.sum((q.T @ y) ** 2)), rank + q.shape[1]


def _scale(columns: BlockAngular) -> FloatArray:
    """Return by what the columns (p,) must be multiplied to have length 1; 0 of those of nothing."""
    lengths = columns.lengths
    return np.where(lengths > 1e-300, 1.0 / np.maximum(lengths, 1e-300), 0.0)


def _run_bases(columns: BlockAngular, left: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield rows and basis of each run's own columns; they are taken out of the shared ones, `left` (n, s)."""
    scale = _scale(columns)
    for part in columns.parts:
        q, mine = _leading(part.block * scale[part.columns]), _slice_of(part.rows)
        for _ in range(2):  # once leaves rounding of what it takes out
            left[mine] -= q @ (q.T @ left[mine])
        yield part.rows, q


def _leading(columns: FloatArray, least: float = 0.0) -> FloatArray:
    """Return the left singular vectors of what is not dust beside the largest singular value, or beside `least`.

    They may take the memory of `columns`, which are then overwritten.
    """
    if columns.shape[1] == 0:
        return np.zeros((len(columns), 0))
    left, singular, _ = tall_svd(columns)
    return left[:, : np.count_nonzero(singular > RANK * max(float(singular.max(initial=0.0)), least))]


#: Rows that are factorised at a time.
_ROWS = 4096


def tall_svd(columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return U (n, k), s (k,) and V' (k, k) of columns U diag(s) V' (n, k), which are overwritten.

    Many rows are factorised block by block, in the memory of the columns: B_i = Q_i R_i, and with the singular vectors
    U_i of all R_i, stacked, those of all B_i are Q_i U_i.
    """
    if len(columns) <= max(_ROWS, 2 * columns.shape[1]) or not columns.shape[1]:
        left, singular, right = np.linalg.svd(columns, full_matrices=False)
        return left, checked(singular), right
    blocks, triangles = [columns[at : at + _ROWS] for at in range(0, len(columns), _ROWS)], []
    for block in blocks:
        q, r = np.linalg.qr(block)
        block[:, : q.shape[1]] = q
        triangles.append(r)
    left, singular, right = np.linalg.svd(np.concatenate(triangles), full_matrices=False)
    ends = np.cumsum([0, *map(len, triangles)])
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        block[:] = block[:, : last - first] @ left[first:last]
    return columns, checked(singular), right
