"""The test of sizes that are drawn at random, and the tail of its weighted sum of squares.

Columns S with scores u = S' z and information I = S' S are tested for sizes that are all drawn from N(0, a^2), against
none [Lin1997]. With the eigenvalues v of I,

    T = a^2 u' (1 + a^2 I)^-1 u,   sum_i a^2 v_i = 100

is under noise alone a sum of chi2(1) with weights w = a^2 v / (1 + a^2 v). Where all columns are seen alike it is the
chi2 test of them all. Where some are seen far better, it asks these; chi2 counts all axes alike, and they drown in the
others. 100 is the sum of squares that such sizes explain on average. What is explained beyond chance is at least
(T - sum w) / max w.

The tail is that of the saddlepoint [Lugannani1980]:

    K(s) = -1/2 sum_i ln(1 - 2 w_i s),   K'(s) = t
    P(T > t) = 1 - Phi(a + ln(b / a) / a),   a = sign(s) sqrt(2 (s t - K(s))),   b = s sqrt(K''(s))

With f(c) = ln det(1 + c I), K(s) = (f(a^2) - f((1 - 2 s) a^2)) / 2. Of I = diag(d) - B B' with B of few columns no
eigenvalues are needed: the determinant is that of a matrix of that size, times the product of 1 + c d.

Right to a few per cent, however far out; a chi2 of the same mean and variance is not where weights differ. Where the
noise is known but for a factor e^h, h ~ N(0, doubt^2), P is the mean over h of P(T > t / e^h).

[Lin1997] X. Lin, Variance component testing in generalised linear models with random effects, Biometrika 84.
[Lugannani1980] R. Lugannani and S. Rice, Advances in Applied Probability 12.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats
from scipy.sparse.linalg import LinearOperator, eigsh

from mjfish.arrays import FloatArray

#: Weights below this share of the largest are rounding.
_ROUNDING = 1e-10
#: |a| below which the formula is a quotient of rounding errors, and its limit 1/2 - skewness / (6 sqrt(2 pi)) does.
_MIDDLE = 1e-3
#: Nodes of the mean over h.
_NODES = 21
#: Up to so many columns the largest eigenvalue comes from all of them.
_FEW = 64


class Weights(Protocol):
    """The weights of a sum of squares: how many, the largest, and K, K', K'' at s."""

    @property
    def count(self) -> int:
        """How many they are."""

    @property
    def largest(self) -> float:
        """The largest."""

    def cumulants(self, s: float) -> tuple[float, float, float]:
        """Return K, K', K'' at s below 1 / (2 largest)."""


@dataclass(frozen=True, eq=False)
class Plain:
    """Weights (k,) that are known one by one, none negative."""

    values: FloatArray

    @property
    def count(self) -> int:
        """How many are not rounding."""
        return int(np.count_nonzero(self.values > _ROUNDING * self.largest))

    @property
    def largest(self) -> float:
        """The largest."""
        return float(self.values.max(initial=0.0))

    def cumulants(self, s: float) -> tuple[float, float, float]:
        """Return K, K', K'' at s."""
        w, left = self.values, 1.0 - 2.0 * self.values * s
        return float(-0.5 * np.sum(np.log(left))), float(np.sum(w / left)), float(np.sum(2.0 * (w / left) ** 2))


@dataclass(frozen=True, eq=False)
class Ridge:
    """Weights a^2 v / (1 + a^2 v) of the eigenvalues v of I = diag(d) - B B'.

    Attributes:
        values: (k,) d, ascending.
        coupling: (k, s) B, in the same order.
        order: (k,) by which they were sorted.
        variance: a^2.
        greatest: eigenvalue of I.
    """

    values: FloatArray
    coupling: FloatArray
    order: NDArray[np.intp]
    variance: float
    greatest: float

    @classmethod
    def of(cls, values: FloatArray, coupling: FloatArray, explained: float) -> Ridge:
        """Return the weights with a^2 such that the sizes explain a sum of squares on average."""
        order = np.argsort(values)
        d, b = values[order], coupling[order]
        return cls(d, b, order, explained / max(float(d.sum() - np.sum(b**2)), 1e-300), max(_greatest(d, b), 0.0))

    @property
    def count(self) -> int:
        """How many eigenvalues are not rounding, at most."""
        return int(np.count_nonzero(self.values > _ROUNDING * self.values.max(initial=0.0)))

    @property
    def largest(self) -> float:
        """The largest weight."""
        return self.variance * self.greatest / (1.0 + self.variance * self.greatest)

    @property
    def total(self) -> float:
        """The sum of the weights."""
        return self.variance * self._at_variance[1]

    def statistic(self, score: FloatArray) -> float:
        """Return T of a score (k,), in the order that `of` was given."""
        c, score = self.variance, score[self.order]
        inverse = 1.0 / (1.0 + c * self.values)
        inner = self.coupling.T @ (inverse * score)
        small = np.eye(len(inner)) - c * self.coupling.T @ (inverse[:, None] * self.coupling)
        return float(c * (score @ (inverse * score) + c * inner @ np.linalg.solve(small, inner)))

    def cumulants(self, s: float) -> tuple[float, float, float]:
        """Return K, K', K'' at s."""
        a = self.variance
        value, first, second = self._log_determinant((1.0 - 2.0 * s) * a)
        return 0.5 * (self._at_variance[0] - value), a * first, -2.0 * a**2 * second

    @cached_property
    def _at_variance(self) -> tuple[float, float, float]:
        return self._log_determinant(self.variance)

    def _log_determinant(self, c: float) -> tuple[float, float, float]:
        """Return f(c) = ln det(1 + c I), f', f''.

        The largest d, one more than B has columns, stay in the small matrix: only these may exceed the greatest
        eigenvalue (Cauchy), where 1 + c d changes its sign first.
        """
        top = min(self.coupling.shape[1] + 1, len(self.values))
        d, b = self.values[: len(self.values) - top], self.coupling[: len(self.values) - top]
        d_top, b_top = self.values[len(d) :], self.coupling[len(d) :]
        e = 1.0 / (1.0 + c * d)
        s = b.shape[1]
        m0, m1, m2 = (b.T @ (w[:, None] * b) for w in (e, e**2, d * e**3))
        zero = np.zeros((s, top))
        small = np.block([[np.diag(1.0 + c * d_top), c * b_top], [b_top.T, np.eye(s) - c * m0]])
        rate = np.block([[np.diag(d_top), b_top], [zero, -m1]])
        bend = np.block([[np.zeros((top, top + s))], [zero, 2.0 * m2]])
        along, across = np.linalg.solve(small, rate), np.linalg.solve(small, bend)
        value = float(np.sum(np.log1p(c * d)) + np.linalg.slogdet(small)[1])
        first = float(np.sum(d * e) + np.trace(along))
        second = float(-np.sum((d * e) ** 2) + np.trace(across) - np.sum(along * along.T))
        return value, first, second


def _greatest(d: FloatArray, b: FloatArray) -> float:
    """Return the greatest eigenvalue of diag(d) - B B'."""
    if len(d) <= _FEW:
        return float(np.linalg.eigvalsh(np.diag(d) - b @ b.T)[-1]) if len(d) else 0.0
    times = LinearOperator((len(d), len(d)), matvec=lambda x: d * x.ravel() - b @ (b.T @ x.ravel()), dtype=np.float64)
    return float(eigsh(times, k=1, which="LA", v0=np.ones(len(d)), return_eigenvectors=False)[0])


def weighted_tail(statistic: float, weights: FloatArray | Weights, doubt: float = 0.0) -> float:
    """Return the p value of a sum of squares.

    Args:
        statistic: t.
        weights: (k,) w, none negative, or what is known of them.
        doubt: standard deviation of the logarithm of the variance of the noise.
    """
    known = Plain(weights[weights > 0.0]) if isinstance(weights, np.ndarray) else weights
    if not known.count or not known.largest > 0.0 or statistic <= 0.0:
        return 1.0
    if doubt == 0.0:
        return _tail(statistic, known)
    nodes, shares = np.polynomial.hermite_e.hermegauss(_NODES)
    tails = [_tail(statistic * float(np.exp(-doubt * node)), known) for node in nodes]
    return float(shares @ tails / shares.sum())


def _tail(t: float, weights: Weights) -> float:
    one = weights.largest
    low, high = -0.5 * weights.count / t - 1.0 / one, (0.5 - 1e-13) / one
    s = optimize.brentq(lambda s: weights.cumulants(s)[1] - t, low, high, xtol=1e-15 / one)
    value, _, bend = weights.cumulants(s)
    a = np.sign(s) * np.sqrt(max(2.0 * (s * t - value), 0.0))
    if abs(a) < _MIDDLE:
        _, _, bend = weights.cumulants(0.0)
        step = 1e-4 / one
        third = (weights.cumulants(step)[2] - weights.cumulants(-step)[2]) / (2.0 * step)
        return float(0.5 - third / bend**1.5 / (6.0 * np.sqrt(2.0 * np.pi)))
    b = s * np.sqrt(bend)
    return float(stats.norm.sf(a + np.log(b / a) / a))
