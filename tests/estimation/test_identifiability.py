"""Weak directions come out in words, from Jacobians made to have them and from swimming that has them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from changed_fit import having
from synthetic_swimming import problem, swimming

from mjfish.estimation import Fit, fit
from mjfish.estimation.fit import covariance
from mjfish.estimation.identifiability import weaknesses
from mjfish.files.plain_data import plain
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import BlockAngular


@pytest.fixture(scope="module")
def fitted(pike: Fish) -> Fit:
    return fit(problem(swimming(pike, ("v1", "v5"), duration=2.0)))


def _with(fitted: Fit, jacobian: FloatArray, sse: float | None = None) -> Fit:
    """Return the fit with another Jacobian, and its covariance."""
    spread = covariance(BlockAngular.of(jacobian), fitted.at_bound)
    return having(
        fitted,
        jacobian=BlockAngular.of(jacobian),
        covariance=spread,
        sse=float(len(jacobian) - 9) if sse is None else sse,
    )


def _apart(fitted: Fit, error: float = 0.01) -> FloatArray:
    """Return orthogonal columns that know every parameter to `error` of its range."""
    n = len(fitted.residual)
    left = np.linalg.qr(np.random.default_rng(0).standard_normal((n, 9)))[0]
    return np.asarray(left / (error * np.array([p.high - p.low for p in fitted.parameters])))


def _tied(columns: FloatArray, pair: tuple[int, int], correlation: float) -> FloatArray:
    """Return columns of which two give their estimates this correlation."""
    tied = columns.copy()
    length = np.linalg.norm(columns, axis=0)
    one, two = columns[:, pair[0]] / length[pair[0]], columns[:, pair[1]] / length[pair[1]]
    tied[:, pair[1]] = length[pair[1]] * (-correlation * one + np.sqrt(1.0 - correlation**2) * two)
    return tied


def test_orthogonal_parameters_have_no_weakness(fitted: Fit) -> None:
    assert weaknesses(_with(fitted, _apart(fitted))) == ()


@pytest.mark.parametrize(
    ("correlation", "words"),
    [
        (0.98, "c_m.body and c_m.tail cannot be told apart on these data: correlation 0.98"),
        (-0.98, "c_m.body and c_m.tail cannot be told apart on these data: correlation -0.98"),
        (0.96, "c_m.body and c_m.tail are hard to tell apart on these data: correlation 0.96"),
        (0.999996, "c_m.body and c_m.tail cannot be told apart on these data: correlation 0.999996"),
    ],
)
def test_a_pair_is_named_with_the_correlation_of_its_estimates(fitted: Fit, correlation: float, words: str) -> None:
    """The sign is that of the estimates, not of the columns, and no correlation is rounded to 1."""
    tied = _with(fitted, _tied(_apart(fitted, 0.001), (1, 2), correlation))
    assert tied.correlation[1, 2] == pytest.approx(correlation, abs=1e-6)
    (one,) = weaknesses(tied)
    assert one.kind == "pair"
    assert sorted(one.parameters) == ["c_m.body", "c_m.tail"]
    assert {word for word in words.split() if word not in one.text.split()} == set()


def test_a_weaker_pair_is_left_alone(fitted: Fit) -> None:
    assert weaknesses(_with(fitted, _tied(_apart(fitted), (1, 2), 0.9))) == ()


def test_of_three_tied_parameters_the_combination_is_named_with_its_amounts(fitted: Fit) -> None:
    """Pairs among the three are not named again; moving along the amounts changes the sum of squares by 1."""
    columns = _apart(fitted)
    length = np.linalg.norm(columns, axis=0)
    unit = columns / length
    columns[:, 8] = length[8] * (0.7 * unit[:, 3] - 0.7 * unit[:, 5] + 0.02 * unit[:, 8])
    tied = _with(fitted, columns)
    (one,) = weaknesses(tied)
    assert one.kind == "combination"
    assert set(one.parameters) == {"c_d.head", "c_d.tail", "c_f.tail"}
    assert one.text.startswith("only a combination of ")
    names = [p.name for p in tied.parameters]
    move = columns[:, [names.index(name) for name in one.parameters]] @ np.array(one.changes)
    assert move @ move == pytest.approx(1.0, rel=1e-6)


def test_what_nothing_moves_is_said_and_spoils_nothing_else(fitted: Fit) -> None:
    columns = _tied(_apart(fitted), (1, 2), 0.98)
    columns[:, 4] = 0.0
    first, second = weaknesses(_with(fitted, columns))
    assert (first.kind, first.parameters) == ("unmoved", ("c_d.body",))
    assert first.text.startswith("nothing in these data moves c_d.body")
    assert second.kind == "pair"


def test_a_parameter_below_the_noise_over_all_its_range_is_faint(fitted: Fit) -> None:
    """And the noise counts as large as the residual is: with ten times the residual a second one drowns."""
    columns = _apart(fitted)
    columns[:, 4] *= 0.005
    columns[:, 5] *= 0.05
    (one,) = weaknesses(_with(fitted, columns))
    assert (one.kind, one.parameters) == ("faint", ("c_d.body",))
    found = weaknesses(_with(fitted, columns, sse=100.0 * len(columns)))
    assert [w.parameters for w in found if w.kind == "faint"] == [("c_d.body",), ("c_d.tail",)]


def test_parameters_at_a_bound_are_not_named(fitted: Fit) -> None:
    held = replace(fitted, at_bound=np.arange(9) == 2)
    assert weaknesses(_with(held, _tied(_apart(fitted), (1, 2), 0.99))) == ()


def test_short_swimming_sees_only_a_combination_of_skin_frictions(fitted: Fit) -> None:
    """Two seconds of it; along the named direction the exact prediction changes no more than the noise."""
    one = weaknesses(fitted)[0]
    assert set(one.parameters) == {"c_f.head", "c_f.body", "c_f.tail"}
    assert json.loads(json.dumps(plain(one)))["kind"] == "combination"
    names = [p.name for p in fitted.parameters]
    move = np.zeros(9)
    move[[names.index(name) for name in one.parameters]] = one.changes
    assert np.linalg.norm(fitted.jacobian @ move) == pytest.approx(1.0, abs=0.1)
    alone = np.where(np.arange(9) == names.index("c_f.body"), move, 0.0)
    assert np.linalg.norm(fitted.jacobian @ alone) > 10.0
