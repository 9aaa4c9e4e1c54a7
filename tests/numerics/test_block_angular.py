"""Block angular matrices against the same ones with their zeros."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.numerics.arrays import orthonormal
from mjfish.numerics.block_angular import BlockAngular, Part, explained, span

RUNS, ROWS, OWN, SHARED = 3, 8, 2, 4


def _matrix(seed: int = 0, *, twin: bool = False) -> BlockAngular:
    """Return a matrix of three runs, columns of shared and own parameters in mixed order.

    Args:
        seed: of its numbers.
        twin: whether a shared column is a run's own column in the rows of that run, and zero elsewhere.
    """
    rng = np.random.default_rng(seed)
    places = rng.permutation(SHARED + RUNS * OWN)
    rows = [np.arange(r * ROWS, (r + 1) * ROWS) for r in range(RUNS)]
    own = np.split(places[SHARED:], RUNS)
    parts = tuple(Part(at, columns, rng.standard_normal((ROWS, OWN))) for at, columns in zip(rows, own, strict=True))
    shared = rng.standard_normal((RUNS * ROWS, SHARED))
    if twin:
        shared[:, 0] = 0.0
        shared[rows[1], 0] = parts[1].block @ [1.0, 2.0]
    return BlockAngular(shared, places[:SHARED], parts)


def test_products_and_choices_are_those_of_the_dense_matrix() -> None:
    j = _matrix()
    dense, rng = j.dense(), np.random.default_rng(1)
    x, y = rng.standard_normal((j.shape[1], 2)), rng.standard_normal((len(dense), 2))
    np.testing.assert_allclose(j @ x, dense @ x, atol=1e-13)
    np.testing.assert_allclose(j.transposed_times(y), dense.T @ y, atol=1e-13)
    np.testing.assert_allclose(j.gram(), dense.T @ dense, atol=1e-13)
    np.testing.assert_allclose(j.lengths, np.linalg.norm(dense, axis=0))
    which = rng.random(j.shape[1]) < 0.6
    np.testing.assert_array_equal(j.chosen(which).dense(), dense[:, which])
    np.testing.assert_array_equal(j.of_columns([3, 0]), dense[:, [3, 0]])
    np.testing.assert_array_equal(j.top(11).dense(), dense[:11])
    rows, columns = rng.random(len(dense)), rng.random(j.shape[1])
    np.testing.assert_allclose(j.scaled(rows, columns).dense(), rows[:, None] * dense * columns)
    other = _matrix(2)
    np.testing.assert_array_equal(j.beside(other).dense(), np.hstack([dense, other.dense()]))


def test_rows_below_belong_to_the_run_whose_columns_they_have() -> None:
    j = _matrix()
    below = np.zeros((3, j.shape[1]))
    below[0, j.places[0]], below[1, j.parts[2].columns[1]], below[2, j.parts[0].columns[0]] = 1.0, 2.0, 3.0
    whole = j.above(below)
    np.testing.assert_array_equal(whole.dense(), np.concatenate([j.dense(), below]))
    np.testing.assert_array_equal(whole.of_rows(np.array([25, 3])), whole.dense()[[25, 3]])
    np.testing.assert_array_equal(whole.beside(_grown(3)).dense(), np.hstack([whole.dense(), _grown(3).dense()]))


def _grown(rows: int) -> BlockAngular:
    """Return another matrix with zero rows below."""
    other = _matrix(4)
    return other.above(np.zeros((rows, other.shape[1])))


def test_the_factors_are_an_orthogonal_factorisation() -> None:
    j = _matrix()
    q = j.factors.basis.of_rows(np.arange(len(j.shared)))
    np.testing.assert_allclose(q.T @ q, np.eye(j.shape[1]), atol=1e-13)
    np.testing.assert_allclose(q @ j.factors.triangle.dense(), j.dense(), atol=1e-13)
    y = np.random.default_rng(3).standard_normal(len(j.shared))
    np.testing.assert_allclose(j.solve(y, 1e-8), np.linalg.lstsq(j.dense(), y)[0], atol=1e-12)


@pytest.mark.parametrize("twin", [False, True])
def test_the_span_is_that_of_the_columns(twin: bool) -> None:
    """A shared column that a run's own columns explain counts once."""
    j = _matrix(twin=twin)
    basis, dense = span(j), orthonormal(j.dense())
    assert basis.rank == dense.shape[1] == j.shape[1] - twin
    y = np.random.default_rng(3).standard_normal((len(j.shared), 2))
    np.testing.assert_allclose(basis.off(y), y - dense @ (dense.T @ y), atol=1e-12)
    assert basis.explained(y[:, 0]) == pytest.approx(float(np.sum((dense.T @ y[:, 0]) ** 2)))


def test_what_a_span_explains_needs_no_basis_of_single_runs() -> None:
    j, y = _matrix(twin=True), np.random.default_rng(3).standard_normal(RUNS * ROWS)
    total, rank = explained(j, y)
    assert rank == span(j).rank
    assert total == pytest.approx(span(j).explained(y), rel=1e-12)


def test_the_span_of_many_rows_is_made_block_by_block() -> None:
    """Of 9001 rows in three blocks, the last one shorter; a column that depends on others counts once."""
    columns = np.random.default_rng(5).standard_normal((9001, 5))
    columns[:, 4] = columns[:, :2] @ [1.0, -1e3] + 1e-13 * columns[:, 3]
    kept = columns.copy()
    basis = span(BlockAngular.of(columns))
    np.testing.assert_array_equal(columns, kept)
    np.testing.assert_allclose(basis.shared.T @ basis.shared, np.eye(4), atol=1e-13)
    np.testing.assert_allclose(basis.off(columns), 0.0, atol=1e-10)


def test_rows_of_what_is_off_the_span() -> None:
    j, y = _matrix(), np.random.default_rng(3).standard_normal((RUNS * ROWS, 2))
    basis, rows = span(j), j.parts[1].rows[2:5]
    np.testing.assert_allclose(basis.off_at(rows, y, basis.coordinates(y)), basis.off(y)[rows], atol=1e-13)


def test_columns_of_nothing_have_no_span() -> None:
    j = _matrix()
    nothing = j.scaled(columns=np.zeros(j.shape[1]))
    assert span(nothing).rank == 0
    np.testing.assert_array_equal(span(nothing).off(np.ones(len(j.shared))), 1.0)


def test_sparse_is_the_dense_matrix_with_nothing_below() -> None:
    dense = _matrix().dense()
    np.testing.assert_array_equal(_matrix().sparse(len(dense) + 1).toarray(), np.pad(dense, ((0, 1), (0, 0))))


def test_the_inverse_of_the_gram_matrix_needs_none_of_all_columns() -> None:
    j = _matrix()
    dense = j.dense()
    np.testing.assert_allclose(j.factors.triangle.inverse_gram(1e-10), np.linalg.inv(dense.T @ dense), atol=1e-12)


def test_a_direction_that_nothing_moves_has_a_huge_variance_and_takes_nothing_from_the_others() -> None:
    """The second own column of a run is twice the first: rows of the run still tell of the shared columns as before."""
    whole = _matrix()
    first, *others = whole.parts
    twice = Part(first.rows, first.columns, first.block[:, :1] @ [[1.0, 2.0]])
    found = BlockAngular(whole.shared, whole.places, (twice, *others)).factors.triangle.inverse_gram(1e-10)
    known = np.delete(np.arange(whole.shape[1]), first.columns[1])
    dense = whole.dense()[:, known]
    expected = np.linalg.inv(dense.T @ dense)
    kept = [int(np.flatnonzero(known == place)[0]) for place in whole.places]
    np.testing.assert_allclose(found[np.ix_(whole.places, whole.places)], expected[np.ix_(kept, kept)], atol=1e-12)
    assert found[first.columns[0], first.columns[0]] > 1e15
