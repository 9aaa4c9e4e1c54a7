"""Residual analysis: whiteness, and independence of the input, with one p value for each question.

**Whiteness.** Ljung-Box per trial and channel, and per channel over all trials.

    r_k = sum_t e_t e_{t+k} / sum_t e_t^2
    Q   = sum_{k=1..m} r_k^2 / var r_k,     var r_k = n_k / (n (n + 2))

with n samples, n_k pairs at lag k (n - k without gaps: [LjungBox1978]); under white e, Q is about chi-squared with
m - p degrees of freedom, p the order of an autoregressive noise model that was fitted to the same residuals. Its
variance is larger than that of chi-squared, by 1 + 2 m / n (measured: 1.33, 1.16, 1.10, 1.01 at m = 25 and n = 150,
320, 521, 5210, 20000 draws), which is taken into account by matching both moments. The nine coefficients cost no
freedom: they shift r_k by less than their number over the number of samples. Over trials, r_k is the mean weighted by
samples, so that a trial with larger noise does not rule. The mean is not taken out: an offset is a misfit too.

**Independence.** Cross-correlation with the joint command, with the variance it really has. The input u is the command
of the last joint that moves, or its square: the first turns with the beat, the second twice a beat about a mean, as
sway and surge do. The covariance of the residual e with u at lag tau, r(tau) = sum_t e_t u(t - tau), has, if they are
independent, the variance

    var r(tau) = sum_{t,s} u(t - tau) R_e(t - s) u(s - tau) = N sum_k R_e(k) R_u(k)        [Ljung1999], eq. (16.70)

The input is periodic: R_u does not decay, and neither do the correlations between the r(tau) at different lags. So

- the sum is done in full, as sigma^2 |A^-T u|^2 with A the autoregressive noise model of the residual, which is
  estimated after everything in the span of the lagged inputs is taken out (`background`): a line of the input in the
  residual would else pass for noise and hide itself;
- what the fit has taken is taken out of u, too: with J the sensitivities and W the weights, the residual of noise v is
  e = (I - J (J'W J)^-1 J'W) v, so that e'u = v'u~ with u~ = u - W J (J'W J)^-1 J'u. Sensitivities are locked to the
  beat as well: without this, the test of a fitted residual would speak too seldom;
- the p value is of all lags jointly: in an orthonormal basis of the lagged inputs (two directions for each frequency
  of the drive), the quadratic form of the inverse covariance, over its degrees of freedom F-distributed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import linalg, signal, stats

from mjfish.arrays import BoolArray, FloatArray
from mjfish.block_angular import tall_svd
from mjfish.errors import InputError
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Residual, fitted
from mjfish.fish import Cpg
from mjfish.frames import CHANNELS
from mjfish.model import asked_motion
from mjfish.noise import Autoregressive, Noise
from mjfish.noise.autoregressive import by_order, highest_order, lagged_products
from mjfish.ode.rollout import STEP

#: Lags that are tested by default, and what a band leaves out.
LAGS = 25
BAND = 0.01
#: Name of the row over all trials.
ALL = "all"


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """Autocorrelation of the residual of one channel.

    Attributes:
        trial: its name, or ``all``.
        channel: ``surge``, ``sway`` or ``yaw_rate``.
        lag: (m,) in samples, from 1 on.
        value: (m,) r_k.
        band: (m,) half width that 99 % of r_k lie in where the residual is white.
        statistic: Q / (1 + 2 m / n).
        degrees_of_freedom: its degrees of freedom.
        p_value: chance of a larger Q.
    """

    trial: str
    channel: str
    lag: FloatArray
    value: FloatArray
    band: FloatArray
    statistic: float
    degrees_of_freedom: float
    p_value: float


def whiteness(
    residuals: Sequence[Residual], noise: Noise, *, lags: int = LAGS, spent: int | None = None
) -> tuple[Autocorrelation, ...]:
    """Test the residuals of every trial and channel, then of every channel over all trials.

    Args:
        residuals: of the trials.
        noise: what they are said to be; of autoregressive noise, the innovations are tested.
        lags: m; fewer where the shortest trial has less than four samples a lag.
        spent: degrees of freedom that the noise model took; None: its order.

    Raises:
        InputError: no lag can be tested.
    """
    taken = noise.order if spent is None else spent
    white = [_standardised(residual, noise) for residual in residuals]
    m = min([lags, *(int(np.isfinite(block).sum(axis=0).min()) // 4 for block in white)])
    if m - taken < 1:
        raise InputError(
            f"whiteness: {m} lags can be tested and the noise model took {taken}; expected more lags than that; "
            "record longer trials or ask for more lags"
        )
    found = []
    for channel, name in enumerate(CHANNELS):
        values, variances, weights = [], [], []
        for residual, block in zip(residuals, white, strict=True):
            value, variance, n = _correlation(block[:, channel], m)
            found.append(_tested(residual.trial.name, name, value, variance, m - taken, n))
            values.append(value)
            variances.append(variance)
            weights.append(n)
        share = np.array(weights)[:, None] / max(sum(weights), 1)
        pooled = (np.sum(share * values, axis=0), np.sum(share**2 * variances, axis=0))
        found.append(_tested(ALL, name, *pooled, m - taken, sum(weights)))
    return tuple(found)


def _standardised(residual: Residual, noise: Noise) -> FloatArray:
    """Return innovations of unit variance (m, 3) on the grid, NaN in gaps; empty after a divergence."""
    if residual.diverged:
        return np.full((1, 3), np.nan)
    values, variance = Autoregressive(noise.sigma, noise.phi).innovations(residual.on_grid(residual.values))
    return np.asarray(values / np.sqrt(variance))


def _correlation(series: FloatArray, lags: int) -> tuple[FloatArray, FloatArray, int]:
    """Return r_k, var r_k for k = 1..lags, and the number of samples, of a series with gaps."""
    there = np.isfinite(series)
    e, n = np.where(there, series, 0.0), int(there.sum())
    pairs = np.array([np.count_nonzero(there[k:] & there[:-k]) for k in range(1, lags + 1)])
    products = np.array([e[k:] @ e[:-k] for k in range(1, lags + 1)])
    return products / max(float(e @ e), 1e-300), np.maximum(pairs, 1) / (n * (n + 2.0)), n


def _tested(
    trial: str, channel: str, value: FloatArray, variance: FloatArray, degrees_of_freedom: int, n: int
) -> Autocorrelation:
    wider = 1.0 + 2.0 * len(value) / max(n, 1)
    statistic = float(np.sum(value**2 / variance)) / wider
    return Autocorrelation(
        trial=trial,
        channel=channel,
        lag=np.arange(1.0, len(value) + 1.0),
        value=value,
        band=np.asarray(stats.norm.isf(BAND / 2.0) * np.sqrt(variance)),
        statistic=statistic,
        degrees_of_freedom=degrees_of_freedom / wider,
        p_value=float(stats.chi2.sf(statistic, degrees_of_freedom / wider)),
    )


#: Inputs by name, from the angle of the last joint that moves [rad].
INPUTS: dict[str, Callable[[FloatArray], FloatArray]] = {"beat": lambda angle: angle, "double_beat": np.square}
#: Lags of the residual behind the input [s]: both signs, for a clock may be ahead.
LAG = np.linspace(-0.5, 0.5, 51)
#: Directions below these shares of the largest singular value: not tested; not even in the bands.
_MAIN, _ALL = 0.1, 0.01
#: Directions of which the fit has left less than this share of their variance are not tested.
_LEFT = 0.05
#: Rounds until model and notch agree: the notch is a small part, every round gains a digit or more.
_ROUNDS = 4
#: Samples before the first over which a noise model is continued: its memory.
_MEMORY = 400
#: Directions in parameter space that the data move less than this, relative to the strongest, take nothing out.
_FLOOR = 1e-9
#: Columns that are whitened at a time, samples of which the input is taken at a time.
_UNIT_COLUMNS, _SAMPLES = 300, 8192


@dataclass(frozen=True, eq=False)
class CrossCorrelation:
    """Cross-correlation of the residual of one channel with one input.

    Attributes:
        trial: its name, or ``all``: the values are then of the sum over trials, and the p value is of all trials
            jointly, each with a response of its own.
        channel: ``surge``, ``sway`` or ``yaw_rate``.
        input: ``beat`` or ``double_beat``.
        lag: (l,) of the residual behind the input [s].
        value: (l,) correlation coefficient.
        band: (l,) half width that 99 % of the values lie in where residual and input are independent.
        statistic: of all lags jointly.
        degrees_of_freedom: number of directions.
        p_value: of the statistic; NaN where the fit has taken every direction, or no joint moves.
    """

    trial: str
    channel: str
    input: str
    lag: FloatArray
    value: FloatArray
    band: FloatArray
    statistic: float
    degrees_of_freedom: int
    p_value: float


def independence(
    residuals: Sequence[Residual], cpg: Cpg | None, absorbed: Absorbed | None = None
) -> tuple[CrossCorrelation, ...]:
    """Test the residuals of every channel against every input, per trial and over all trials.

    Args:
        residuals: of trials that did not diverge.
        cpg: of the fish.
        absorbed: what the fit has taken out of the residuals; None: they were not fitted. Residuals of held-out
            trials also carry the error of the estimates, which is not allowed for: it must be small beside the noise.
    """
    designs = {name: [lagged(cpg, residual, name) for residual in residuals] for name in INPUTS}
    noises = _background(residuals, designs, absorbed)
    left = [  # zero where any channel is missing or the sample does not count
        np.where(np.all(np.isfinite(residual.values), axis=1)[:, None], residual.values, 0.0) for residual in residuals
    ]
    found = []
    for channel in range(len(CHANNELS)):
        for name in INPUTS:
            found += _of(channel, name, residuals, left, designs[name], noises, absorbed)
    return tuple(found)


def _background(
    residuals: Sequence[Residual], designs: dict[str, list[Lagged]], absorbed: Absorbed | None
) -> list[Autoregressive]:
    """Estimate the noise beside the lines of the inputs, one model for all trials of a sampling rate."""
    grids, bases = [], []
    for r, residual in enumerate(residuals):
        joined = np.concatenate([designs[name][r].basis[:, : designs[name][r].main] for name in INPUTS], axis=1)
        bases.append(np.nan_to_num(residual.on_grid(linalg.orth(joined) if joined.shape[1] else joined)))
        grids.append(residual.on_grid(residual.values))
    lost = 0.0 if absorbed is None else absorbed.count / (len(CHANNELS) * len(residuals))
    rates = [tuple(bool(np.isclose(a.trial.step, b.trial.step, rtol=0.01)) for b in residuals) for a in residuals]
    found: dict[tuple[bool, ...], Autoregressive] = {}
    for same_rate in rates:
        if same_rate not in found:
            members = np.flatnonzero(same_rate)
            own = [grids[k] for k in members], [bases[k] for k in members]
            found[same_rate] = background(*own, lost * len(members))
    return [found[same_rate] for same_rate in rates]


def _of(
    channel: int,
    name: str,
    residuals: Sequence[Residual],
    left: list[FloatArray],
    designs: list[Lagged],
    noises: list[Autoregressive],
    absorbed: Absorbed | None,
) -> list[CrossCorrelation]:
    """Return the tests of one channel against one input: of every trial, then of all."""
    taken = absorbed or Absorbed.nothing(residuals)
    basis = [np.zeros((*e.shape, design.basis.shape[1])) for e, design in zip(left, designs, strict=True)]
    for block, design in zip(basis, designs, strict=True):
        block[:, channel] = design.basis
    weighed = [taken.weighed(r, len(e)) for r, e in enumerate(left)]
    common = sum(np.einsum("ncs,nc->s", w, e) for w, e in zip(weighed, left, strict=True))
    parts = []
    for r, (u, e, w) in enumerate(zip(basis, left, weighed, strict=True)):
        own, shared = taken.own_cleared(r, u), taken.shared_share(r, u)
        covered = [_shaped(block, residuals[r], noises[r]) for block in (u, own, w)]
        before, after, both, spread = (
            np.sum([one.T @ other for one, other in zip(covered[i], covered[j], strict=True)], axis=0)
            for i, j in ((0, 0), (1, 1), (1, 2), (2, 2))
        )
        score = np.einsum("ncd,nc->d", own, e) - shared.T @ common
        energy = float(e[:, channel] @ e[:, channel])
        parts.append(_Part(designs[r], score, before, after, both, shared, spread, energy))
    samples = sum(int(np.count_nonzero(e[:, channel])) for e in left)
    spare = max(samples - sum(len(part.score) for part in parts), 1)
    spread = np.sum([part.spread for part in parts], axis=0)
    named = [(residual.trial.name, [part]) for residual, part in zip(residuals, parts, strict=True)]
    return [_test(trial, CHANNELS[channel], name, own, spread, spare) for trial, own in [*named, (ALL, parts)]]


def _shaped(block: FloatArray, residual: Residual, noise: Autoregressive) -> list[FloatArray]:
    """Return `coloured` columns (n, 3, d), by channel: the sum of products of two of them is u' S u."""
    grid = np.nan_to_num(residual.on_grid(block))
    return [coloured(noise, channel, grid[:, channel]) for channel in range(len(CHANNELS))]


@dataclass(frozen=True, eq=False)
class _Part:
    """Products of the basis of one trial, U, with the residual, and their covariance before and after the fit.

    With S the covariance of the noise, B what the parameters of the trial alone leave of U, W and T' what the shared
    ones take of all trials (`Absorbed`), the covariance of the products of trials p and q is after the fit

        [p = q] B_p' S B_p - B_p' S W_p T_q - T_p' W_q' S B_q + T_p' (sum_r W_r' S W_r) T_q

    Attributes:
        design: the input.
        score: (d,) products with the residual.
        before: (d, d) U' S U.
        after: (d, d) B' S B.
        both: (d, s) B' S W.
        shared: (s, d) T.
        spread: (s, s) W' S W.
        energy: of the residual.
    """

    design: Lagged
    score: FloatArray
    before: FloatArray
    after: FloatArray
    both: FloatArray
    shared: FloatArray
    spread: FloatArray
    energy: float


def _test(
    trial: str, channel: str, name: str, parts: Sequence[_Part], spread: FloatArray, spare: int
) -> CrossCorrelation:
    """Return the test of some trials jointly, and the correlation of their sum."""
    pairs = [(part.design.loading, part) for part in parts]
    alone = np.sum([np.einsum("il,ij,jl->l", own, part.after, own) for own, part in pairs], axis=0)
    both = np.sum([part.both.T @ own for own, part in pairs], axis=0)
    shared = np.sum([part.shared @ own for own, part in pairs], axis=0)
    variance = alone - 2.0 * np.sum(both * shared, axis=0) + np.einsum("il,ij,jl->l", shared, spread, shared)
    power = np.sum([part.design.power for part in parts], axis=0) * sum(part.energy for part in parts)
    scale = 1.0 / np.sqrt(np.maximum(power, 1e-300))
    statistic, degrees_of_freedom = _quadratic(parts, spread)
    return CrossCorrelation(
        trial=trial,
        channel=channel,
        input=name,
        lag=parts[0].design.lag,
        value=np.sum([own.T @ part.score for own, part in pairs], axis=0) * scale,
        band=np.asarray(stats.norm.isf(BAND / 2.0) * np.sqrt(np.maximum(variance, 0.0)) * scale),
        statistic=statistic,
        degrees_of_freedom=degrees_of_freedom,
        p_value=float(stats.f.sf(statistic / degrees_of_freedom, degrees_of_freedom, spare))
        if degrees_of_freedom
        else np.nan,
    )


def _quadratic(parts: Sequence[_Part], spread: FloatArray) -> tuple[float, int]:
    """Return score' after^+ score and its rank, of main directions without those that the fit has taken.

    First those that the parameters of a trial took of its own, before all others; then those that the shared ones took
    of what was left. With coordinates in which the covariance is 1 but for these, it is 1 + Z K Z', Z of two columns a
    shared direction: its eigenvalues off 1 are those of a matrix of that size.
    """
    along, columns = [], []
    for part in parts:
        main = slice(part.design.main)
        if not part.design.main:
            continue
        shares, directions = linalg.eigh(part.after[main, main], part.before[main, main])
        axes = directions[:, shares > _LEFT] / np.sqrt(shares[shares > _LEFT])
        along.append(axes.T @ part.score[main])
        columns.append(axes.T @ np.hstack([part.both[main], part.shared[:, main].T]))
    if not along:
        return 0.0, 0
    y, z = np.concatenate(along), np.concatenate(columns)
    one = np.eye(len(spread))
    q, r = np.linalg.qr(z)
    shares, directions = np.linalg.eigh(np.eye(len(r)) + r @ np.block([[0.0 * one, -one], [-one, spread]]) @ r.T)
    inside = q.T @ y
    kept = shares > _LEFT
    turned = (directions.T @ inside)[kept]
    statistic = float(y @ y - inside @ inside + np.sum(turned**2 / shares[kept]))
    return statistic, len(y) - int(np.count_nonzero(~kept))


@dataclass(frozen=True, eq=False)
class Lagged:
    """An input at all lags, U = basis loading (n, l).

    Attributes:
        lag: (l,) [s].
        basis: (n, d) orthonormal, strongest direction first; zero where no sample counts.
        loading: (d, l).
        main: number of directions that matter.
        power: (l,) sum of squares of the input over the samples that count.
    """

    lag: FloatArray
    basis: FloatArray
    loading: FloatArray
    main: int
    power: FloatArray


def lagged(cpg: Cpg | None, residual: Residual, name: str) -> Lagged:
    """Return an input of a trial at all lags; before the start and after the end its value there goes on.

    The input is zero, without a direction, where no joint moves.
    """
    motion = asked_motion(cpg, residual.trial, STEP)
    there = np.all(np.isfinite(residual.values), axis=1)
    moving = np.flatnonzero(np.ptp(motion.angle, axis=(0, 1)) > 0.0)
    values = np.zeros((len(there), len(LAG)))
    for first in range(0, len(there) if len(moving) else 0, _SAMPLES):
        rows = slice(first, first + _SAMPLES)
        when = np.clip(residual.trial.time[rows, None] - LAG, motion.time[0], motion.time[-1])
        values[rows] = INPUTS[name](motion.angle_at(when.ravel())[:, moving[-1]].reshape(when.shape))
    values *= there[:, None]
    power = np.einsum("nl,nl->l", values, values)
    left, singular, right = tall_svd(values)
    kept = (singular > _ALL * singular[0]) & (singular > 0.0)
    return Lagged(
        lag=LAG,
        basis=left[:, kept],
        loading=singular[kept, None] * right[kept],
        main=int(np.count_nonzero(singular[kept] > _MAIN * singular[0])),
        power=power,
    )


def background(residuals: Sequence[FloatArray], bases: Sequence[FloatArray], lost: float = 0.0) -> Autoregressive:
    """Estimate the noise of trials of one sampling rate, beside the span of a basis in each.

    Regressing residuals on a basis B takes the lines out, but also the noise that was there; a notch is left. Its noise
    is put back as the model expects it, and model and notch are brought to agree: with P = I - B B', the
    autocovariances are those of

        E[v v' | P v] = P v v' P + B (B' S B) B',     S the covariance of the model so far

    (an EM step that drops what P v says of B'v, [Dempster1977]). The Yule-Walker equations then give the next model.

    Args:
        residuals: (m, 3) a trial, on a grid of equal intervals, NaN in gaps.
        bases: (m, d) orthonormal, zero in the gaps.
        lost: further degrees of freedom a channel that a fit took.
    """
    total = sum(int(np.all(np.isfinite(block), axis=1).sum()) for block in residuals)
    highest = highest_order([len(block) for block in residuals])
    cleared = [
        (e := np.nan_to_num(block)) - basis @ (basis.T @ e) for block, basis in zip(residuals, bases, strict=True)
    ]
    noise = Noise.white(np.sqrt(lagged_products(cleared, 0)[:, 0] / total) + 1e-150)
    for _ in range(_ROUNDS):
        products = lagged_products(cleared, highest)
        for c in range(3):
            products[c] += sum(_expected(noise, c, basis, highest) for basis in bases)
        noise = by_order(products / max(total - lost, 0.1 * total), total)
    return noise


def coloured(noise: Autoregressive, channel: int, columns: FloatArray) -> FloatArray:
    """Return sigma A^-T u of columns u (m, d): the noise filter backwards in time, on past the first sample.

    The product of two of them is u' S u, S the covariance of the noise.
    """
    if noise.order == 0:
        return np.asarray(noise.sigma[channel] * columns)
    longer = np.concatenate([np.zeros((_MEMORY, columns.shape[1])), columns])
    denominator = np.concatenate([[1.0], -noise.phi[channel]])
    return np.asarray(signal.lfilter([noise.sigma[channel]], denominator, longer[::-1], axis=0))


def _expected(noise: Autoregressive, channel: int, basis: FloatArray, highest: int) -> FloatArray:
    """Return the lagged products (highest + 1,) that the noise has in the span of a basis."""
    shaped = coloured(noise, channel, basis)
    spread = basis @ (shaped.T @ shaped)
    return np.array([np.sum(spread[k:] * basis[: len(basis) - k]) for k in range(highest + 1)])


@dataclass(frozen=True, eq=False)
class Absorbed:
    """What a fit takes out of the noise: the residual is orthogonal to the sensitivities, in the metric of the weights.

    With prediction yhat = J x near the estimate, whitening filter F and weights W = F'F, the residual of noise v is

        e = (I - J (J'W J)^+ J'W) v,      so      u'e = (u - W J (J'W J)^+ J'u)' v

    With an orthonormal basis U of F J, and V the same combinations of the columns of J, W J (J'W J)^+ J'u = F'U V'u.

    Attributes:
        masks: (n_r,) samples of every trial that the fit looked at.
        own: V and F'U (n_r', 3, k) of every trial, at those samples: of the parameters that it alone has.
        shared: the same (n_r', 3, s) of those that trials share.
    """

    masks: tuple[BoolArray, ...]
    own: tuple[tuple[FloatArray, FloatArray], ...]
    shared: tuple[tuple[FloatArray, FloatArray], ...]

    @classmethod
    def nothing(cls, residuals: Sequence[Residual]) -> Absorbed:
        """Return what no fit took out of residuals."""
        masks = tuple(np.zeros(len(residual.values), dtype=np.bool_) for residual in residuals)
        empty = tuple((np.zeros((0, 3, 0)), np.zeros((0, 3, 0))) for _ in residuals)
        return cls(masks, empty, empty)

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(sum(v.shape[2] for v, _ in self.own) + self.shared[0][0].shape[2])

    def weighed(self, r: int, samples: int) -> FloatArray:
        """Return F'U (n, 3, s) of the shared directions in one trial, all samples."""
        found = np.zeros((samples, 3, self.shared[r][1].shape[2]))
        found[self.masks[r]] = self.shared[r][1]
        return found

    def own_cleared(self, r: int, columns: FloatArray) -> FloatArray:
        """Return columns u (n, 3, d) of one trial less what its own parameters take of them."""
        v, weighed = self.own[r]
        cleared = columns.copy()
        cleared[self.masks[r]] -= weighed @ np.einsum("nck,ncd->kd", v, columns[self.masks[r]])
        return cleared

    def shared_share(self, r: int, columns: FloatArray) -> FloatArray:
        """Return V'u (s, d) of columns u (n, 3, d) of one trial: what the shared directions take of them."""
        return np.asarray(np.einsum("nck,ncd->kd", self.shared[r][0], columns[self.masks[r]]))


def absorbed(problem: Problem, fit: Fit) -> Absorbed:
    """Return what `fit` took out of the residuals of `problem`: directions of parameters off their bounds."""
    free = {p.name for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True) if not at_bound}
    slopes = problem.slopes(fit.x, free)
    count = len(slopes.shared)
    plain = [block.reshape(3 * len(block), block.shape[2]) for block in slopes.velocity]
    white = [problem.whitened(i, block).reshape(plain[i].shape) for i, block in enumerate(slopes.velocity)]
    size = np.sqrt(np.sum([np.sum(block[:, :count] ** 2, axis=0) for block in white], axis=0))
    own, shared, left = [], [], []
    for j, w in zip(plain, white, strict=True):
        u, v = _orthonormal(w[:, count:], j[:, count:], np.linalg.norm(w[:, count:], axis=0))
        taken = u.T @ w[:, :count]
        own.append((v, u))
        left.append(w[:, :count] - u @ taken)
        shared.append(j[:, :count] - v @ taken)
    ends = np.cumsum([len(block) for block in left])[:-1]
    u, v = _orthonormal(np.concatenate(left), np.concatenate(shared), size)
    parts = list(zip(np.split(v, ends), np.split(u, ends), strict=True))

    def weighed(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[tuple[FloatArray, FloatArray], ...]:
        shaped = [[block.reshape(len(block) // 3, 3, block.shape[1]) for block in pair] for pair in pairs]
        return tuple((v, _whitening_transposed(problem, i, u)) for i, (v, u) in enumerate(shaped))

    return Absorbed(tuple(problem.mask(i) for i in range(len(problem.trials))), weighed(own), weighed(parts))


def _orthonormal(columns: FloatArray, alike: FloatArray, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis of columns (n, k), and the same combinations of columns (m, k) like them.

    Directions are dust below a share of columns of these lengths (k,).
    """
    scale = 1.0 / np.maximum(lengths, 1e-150)
    left, singular, right = np.linalg.svd(columns * scale, full_matrices=False)
    kept = singular > _FLOOR * max(1.0, float(singular.max(initial=0.0)))
    return left[:, kept], (alike * scale) @ (right[kept].T / singular[kept])


def _whitening_transposed(problem: Problem, index: int, block: FloatArray) -> FloatArray:
    """Return F' u of columns u (n, 3, k) of one trial, F the whitening of its counted samples."""
    if block.size == 0 or (isinstance(problem.noise, Autoregressive) and problem.noise.order == 0):
        return np.asarray(block / problem.noise.sigma[:, None])
    rows, result = block.size // block.shape[2], []
    for first in range(0, rows, _UNIT_COLUMNS):  # row by row of F', which is the whitening of unit columns
        unit = np.eye(rows, min(_UNIT_COLUMNS, rows - first), -first).reshape(*block.shape[:2], -1)
        result.append(np.einsum("nck,ncd->kd", problem.whitened(index, unit), block))
    return np.concatenate(result).reshape(block.shape)


Status = Literal["passed", "coloured", "dependent", "untested"]
#: A residual whose p value is below this fails.
LEVEL = 0.01


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Whether anything is left in the residual.

    Attributes:
        whiteness: per channel, every trial and then all.
        independence: per channel and input, every trial and then all.
        p_white: chance of the least white channel, over all trials, if all are; three times the smallest p value.
        p_independent: the same of the channels and inputs.
        skipped: trials whose rollout diverged.
        status: ``passed``; ``coloured`` (independent of the input, not white: intervals that assume white noise are too
            narrow, the model may be right), ``dependent`` (the model misses something that the drive does) or
            ``untested`` (every rollout diverged, or a trial has not all velocities).
    """

    whiteness: tuple[Autocorrelation, ...]
    independence: tuple[CrossCorrelation, ...]
    p_white: float
    p_independent: float
    skipped: tuple[str, ...]
    status: Status


def residual_tests(
    problem: Problem, fit: Fit, residuals: Sequence[Residual] | None = None, *, lags: int = LAGS
) -> ResidualTests:
    """Test the residuals of a fit, which are made here where they are not given."""
    incomplete = tuple(trial.name for trial in problem.trials if not trial.measured.all())
    if incomplete:
        return ResidualTests((), (), np.nan, np.nan, incomplete, "untested")
    taken = None if fit.lost else absorbed(problem, fit)
    return examine(residuals or fitted(problem, fit.x), problem.noise, problem.model.fish.cpg, taken, lags=lags)


def examine(
    residuals: Sequence[Residual],
    noise: Noise,
    cpg: Cpg | None,
    taken: Absorbed | None = None,
    *,
    lags: int = LAGS,
    spent: int | None = None,
) -> ResidualTests:
    """Test residuals, of fitted or of held-out trials.

    Args:
        residuals: of the trials.
        noise: what they are said to be.
        cpg: of the fish.
        taken: what the fit took out of them; None for held-out trials.
        lags, spent: see `mjfish.estimation.residual_tests.whiteness`.
    """
    reached = [residual for residual in residuals if not residual.diverged]
    skipped = tuple(residual.trial.name for residual in residuals if residual.diverged)
    if taken is not None and skipped:
        raise InputError(
            f"trials {', '.join(skipped)} diverged, what a fit took out of them is not known; leave it out"
        )
    if not reached:
        return ResidualTests((), (), np.nan, np.nan, skipped, "untested")
    white = whiteness(reached, noise, lags=lags, spent=spent)
    independent = independence(reached, cpg, taken)
    p_white, p_independent = _least(white), _least(independent)
    status: Status = "passed"
    if p_independent < LEVEL:
        status = "dependent"
    elif p_white < LEVEL:
        status = "coloured"
    return ResidualTests(white, independent, p_white, p_independent, skipped, status)


def _least(tests: Sequence[Autocorrelation] | Sequence[CrossCorrelation]) -> float:
    """Return the smallest p value over all trials, times how many there are (Bonferroni); NaN without any."""
    found = [test.p_value for test in tests if test.trial == ALL and np.isfinite(test.p_value)]
    return min(1.0, len(found) * min(found)) if found else np.nan
