"""Residual analysis: whiteness, and independence of the input, with one p value for each question.

Tested are the whitened residuals w of a fit, of the velocities and of every sensor, channel by channel.

**Whiteness.** Ljung-Box per trial and channel, and per channel over all trials.

    r_k = sum_t w_t w_{t+k} / sum_t w_t^2
    Q   = sum_{k=1..m} r_k^2 / var r_k,     var r_k = n_k / (n (n + 2))

with n samples, n_k pairs at lag k (n - k without gaps: [LjungBox1978]); under white w, Q is about chi-squared with
m - p degrees of freedom, p the order of an autoregressive noise model that was fitted to the same residuals. Its
variance is larger than that of chi-squared, by 1 + 2 m / n (measured: 1.33, 1.16, 1.10, 1.01 at m = 25 and n = 150,
320, 521, 5210, 20000 draws), which is taken into account by matching both moments. The nine coefficients cost no
freedom: they shift r_k by less than their number over the number of samples. Over trials, r_k is the mean weighted by
samples, so that a trial with larger noise does not rule. The mean is not taken out: an offset is a misfit too.

**Independence.** Cross-correlation with the joint command, with the variance it really has. The input is the command
of the last joint that moves, or its square: the first turns with the beat, the second twice a beat about a mean, as
sway and surge do. With U the input at all lags in one channel, whitened as the residual is, and Q an orthonormal basis
of what the fit takes out of the residual, w = (1 - Q Q') v of noise v,

    s = U' w,     var s = U' (1 - Q Q') Omega (1 - Q Q') U

Omega is the covariance of v, of an autoregressive model of each channel that is estimated beside U: what follows the
input in the residual would else pass for noise and hide itself. The input is periodic: it does not decay, and
neither do the correlations between the s of different lags. So the p value is of all lags jointly, of the directions of
U that matter (two for each frequency of the drive), without those that the fit has taken; F-distributed.

[Dempster1977] A. Dempster, N. Laird and D. Rubin, Maximum likelihood from incomplete data via the EM algorithm.
[LjungBox1978] G. Ljung and G. Box, On a measure of lack of fit in time series models, Biometrika 65.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy import linalg, signal, stats

from mjfish.data import Trial
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import Block, serial_blocks
from mjfish.fish.frames import CHANNELS
from mjfish.model import requested_motion
from mjfish.noise import Autoregressive
from mjfish.noise.autoregressive import by_order, highest_order, lagged_products, products_and_pairs
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import Basis, IntArray, span, tall_svd
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
        channel: ``surge``, ``sway`` or ``yaw_rate``, or a channel of a sensor behind its name.
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


@dataclass(frozen=True, eq=False)
class Series:
    """The whitened residual of one channel of one trial.

    Attributes:
        trial: its place in the problem.
        channel: see `Autocorrelation`.
        block: that it is in.
        column: of the block.
    """

    trial: int
    channel: str
    block: Block
    column: int

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.block.trial

    @property
    def samples(self) -> int:
        """Number of samples that count."""
        return len(self.block.cells)

    @property
    def values(self) -> FloatArray:
        """The residual (n,) on a grid of equal steps, NaN where no sample counts."""
        return np.where(self.block.counted, self.block.residual[:, self.column], np.nan)

    def on_grid(self, columns: FloatArray, rows: IntArray) -> FloatArray:
        """Return columns (m, k) in the rows of the trial as they are in this channel (n, k), zero where none counts."""
        found, channels = (
            np.zeros((len(self.block.residual), columns.shape[1])),
            len(self.block.rows) // len(self.block.cells),
        )
        found[self.block.cells] = columns[np.searchsorted(rows, self.block.rows[self.column :: channels])]
        return found


def series_of(problem: Problem, blocks: Sequence[Block]) -> list[Series]:
    """Return every channel that was measured of the blocks of a problem."""
    places = {trial.name: i for i, trial in enumerate(problem.trials)}
    at = [(places[block.trial], block) for block in blocks]
    return [Series(i, name, block, c) for i, block in at for c, name in _channels(problem.trials[i], block.series)]


def _channels(trial: Trial, series: str) -> list[tuple[int, str]]:
    """Return place and name of the measured channels of the velocities or of a sensor of a trial."""
    if not series:
        return [(c, name) for c, name in enumerate(CHANNELS) if trial.measured[c]]
    sensor = next(sensor for sensor in trial.sensors if sensor.name == series)
    return [(c, f"{series} {name}") for c, name in enumerate(sensor.channels)]


def whiteness(series: Sequence[Series], order: int, *, lags: int = LAGS) -> tuple[Autocorrelation, ...]:
    """Test every channel of every trial, then every channel over all trials.

    Args:
        series: whitened residuals; one of too few samples to test a lag is left out.
        order: degrees of freedom that the noise model took.
        lags: m; fewer where the shortest trial has less than four samples a lag.
    """
    found = []
    for channel in dict.fromkeys(one.channel for one in series):
        own = [one for one in series if one.channel == channel and one.samples // 4 > order]
        if not own:
            continue
        m = min(lags, *(one.samples // 4 for one in own))
        parts = [_correlation(one.values, m) for one in own]
        found += [_tested(one.name, channel, *part, m - order) for one, part in zip(own, parts, strict=True)]
        values, variances, counts = (np.array(column) for column in zip(*parts, strict=True))
        share = counts[:, None] / counts.sum()
        pooled = np.sum(share * values, axis=0), np.sum(share**2 * variances, axis=0), int(counts.sum())
        found.append(_tested(ALL, channel, *pooled, m - order))
    return tuple(found)


def _correlation(series: FloatArray, lags: int) -> tuple[FloatArray, FloatArray, int]:
    """Return r_k, var r_k for k = 1..lags, and the number of samples, of a series with gaps."""
    there = np.isfinite(series)
    products, pairs = products_and_pairs([series[there, None]], [there], lags)
    n = int(pairs[0])
    return products[0, 1:] / max(products[0, 0], 1e-300), np.maximum(pairs[1:], 1.0) / (n * (n + 2.0)), n


def _tested(
    trial: str, channel: str, value: FloatArray, variance: FloatArray, n: int, degrees_of_freedom: int
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
_ROUNDS = 5
#: Samples before the first over which a noise model is continued: its memory.
_MEMORY = 400
#: Samples of which the input is taken at a time.
_SAMPLES = 8192


@dataclass(frozen=True, eq=False)
class CrossCorrelation:
    """Cross-correlation of the residual of one channel with one input.

    Attributes:
        trial: its name, or ``all``: the values are then of the sum over trials, and the p value is of all trials
            jointly, each with a response of its own.
        channel: see `Autocorrelation`.
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


@dataclass(frozen=True, eq=False)
class _Scores:
    """Scores of one input in one channel, of one trial or summed over trials.

    With Q = (Q_r, Q_s), of parameters of the trial alone and of those that trials share, and A = (1 - Q_r Q_r') U,

        var s = A' Omega A - A' Omega Q_s Q_s' U - (..)' + U' Q_s (Q_s' Omega Q_s) Q_s' U

    Attributes:
        score: (l,) s.
        power: (l,) diagonal of U' U.
        variance: (l,) diagonal of A' Omega A.
        mixed: (l, k) A' Omega Q_s.
        inside: (l, k) U' Q_s.
        energy: of the residual of the channel, scalar.
        samples: that it has.
        along: (d, 1 + 2 k) score, mixed and inside of the main directions, in which A' Omega A is 1; those of the
            trials below each other.
    """

    score: FloatArray
    power: FloatArray
    variance: FloatArray
    mixed: FloatArray
    inside: FloatArray
    energy: float
    samples: int
    along: FloatArray

    @classmethod
    def summed(cls, parts: Sequence[_Scores]) -> _Scores:
        """Return the scores of several trials."""
        return cls(
            **{name: sum(getattr(p, name) for p in parts) for name in vars(parts[0]) if name != "along"},
            along=np.concatenate([part.along for part in parts]),
        )

    def deviations(self, spread: FloatArray) -> FloatArray:
        """Return the standard deviations (l,) of s; `spread`: (k, k) Q_s' Omega Q_s."""
        shared = np.sum((self.inside @ spread - 2.0 * self.mixed) * self.inside, axis=1)
        return np.asarray(np.sqrt(np.maximum(self.variance + shared, 0.0)))

    def quadratic(self, spread: FloatArray) -> tuple[float, int]:
        """Return s' (var s)^+ s and its rank, of main directions without those that the fit has taken.

        The variance is 1 + Z K Z' with Z = (mixed, inside): its eigenvalues off 1 are those of a small matrix.
        """
        y, z, one = self.along[:, 0], self.along[:, 1:], np.eye(len(spread))
        k = np.block([[np.zeros_like(spread), -one], [-one, spread]])
        q, r = np.linalg.qr(z)
        shares, directions = np.linalg.eigh(np.eye(len(r)) + r @ k @ r.T)
        inside, kept = q.T @ y, shares > _LEFT
        turned = (directions.T @ inside)[kept]
        return float(y @ y - inside @ inside + np.sum(turned**2 / shares[kept])), len(y) - int(np.count_nonzero(~kept))


def independence(problem: Problem, fit: Fit, series: Sequence[Series]) -> tuple[CrossCorrelation, ...]:
    """Test every channel of a fit against every input, per trial and over all trials.

    Args:
        problem: that was fitted.
        fit: of it, which did not diverge.
        series: its residuals; one with less than two samples for a direction of the inputs is left out.
    """
    places = dict.fromkeys((one.trial, one.block.series) for one in series)
    waves = {(*place, name): lagged(problem, *place, name) for place in places for name in INPUTS}
    directions = {place: sum(waves[*place, name].main for name in INPUTS) for place in places}
    enough = [one for one in series if one.samples >= 2 * directions[one.trial, one.block.series]]
    basis = span(fit.jacobian.above(problem.prior_root).chosen(~fit.at_bound))
    setting = _Setting(problem, fit.residual, basis, waves, tuple(enough))
    spread, found = setting.spread(), []
    for channel in dict.fromkeys(one.channel for one in enough):
        own = [one for one in enough if one.channel == channel]
        for name in INPUTS:
            parts = [setting.scores(one, name) for one in own]
            found += [_test(one.name, channel, name, part, spread) for one, part in zip(own, parts, strict=True)]
            found.append(_test(ALL, channel, name, _Scores.summed(parts), spread))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _Setting:
    """What all tests of independence share.

    Attributes:
        problem: that was fitted.
        residual: (n,) of the fit.
        basis: Q.
        waves: of every trial and series, the inputs at all lags.
        series: that are tested.
    """

    problem: Problem
    residual: FloatArray
    basis: Basis
    waves: Mapping[tuple[int, str, str], Lagged]
    series: tuple[Series, ...]

    @cached_property
    def noises(self) -> dict[tuple[str, str], Autoregressive]:
        """The noise of every series beside the lines of the inputs, by trial and channel; one for a sampling rate."""
        found, lost = dict[tuple[str, str], Autoregressive](), self.basis.rank / max(len(self.series), 1)
        for one in self.series:
            if (one.name, one.channel) not in found:
                alike = [
                    o
                    for o in self.series
                    if o.channel == one.channel and np.isclose(o.block.step, one.block.step, rtol=0.01)
                ]
                noise = background([o.values for o in alike], [*map(self._axes, alike)], lost * len(alike))
                found.update({(o.name, o.channel): noise for o in alike})
        return found

    def _axes(self, series: Series) -> FloatArray:
        """Return an orthonormal basis (n, d) of what the inputs do to a channel, on its grid."""
        waves = (self.waves[series.trial, series.block.series, name] for name in INPUTS)
        inputs = [self._whitened(series, one.basis[:, : one.main]) for one in waves]
        left, singular, _ = tall_svd(series.on_grid(np.hstack(inputs), self.problem.trial_rows[series.trial]))
        return left[:, singular > _ALL * singular.max(initial=0.0)]

    def _whitened(self, series: Series, columns: FloatArray) -> FloatArray:
        """Return columns (n, d) in a channel as whitened rows (m, d) of its trial."""
        problem, index, d = self.problem, series.trial, columns.shape[1]
        trial = problem.trials[index]
        velocity = np.zeros((int(np.count_nonzero(problem.mask(index))), len(CHANNELS), d))
        sensors = {sensor.name: np.zeros((*sensor.values.shape, d)) for sensor in trial.sensors}
        {"": velocity, **sensors}[series.block.series][:, series.column] = columns
        white = [problem.whitened(index, velocity), *problem.white_sensors(index, [*sensors.values()])]
        return np.concatenate([block.reshape(block.shape[0] * block.shape[1], d) for block in white])

    def _quadratic(self, trial: int, columns: FloatArray) -> FloatArray:
        """Return C' Omega C (k, k) of columns C (m, k) in the rows of a trial."""
        rows, found = self.problem.trial_rows[trial], np.zeros((columns.shape[1], columns.shape[1]))
        for one in self.series:
            if one.trial == trial and np.any(own := one.on_grid(columns, rows)):
                shaped = coloured(self.noises[one.name, one.channel], own)
                found += shaped.T @ shaped
        return found

    def spread(self) -> FloatArray:
        """Return Q_s' Omega Q_s (k, k); Omega is 1 in the rows behind the measured ones, of what is known before."""
        shared, rows = self.basis.shared, self.problem.trial_rows
        known = shared[self.problem.measured :]
        parts = (self._quadratic(trial, shared[rows[trial]]) for trial in {o.trial for o in self.series})
        return np.asarray(sum(parts, known.T @ known))

    def scores(self, series: Series, name: str) -> _Scores:
        """Return the scores of an input in one channel of a trial."""
        rows, waves = self.problem.trial_rows[series.trial], self.waves[series.trial, series.block.series, name]
        columns, (run, own, shared) = self._whitened(series, waves.basis), self.basis.at(rows)
        taken, d, main = own.T @ columns, columns.shape[1], waves.main
        omega = self._quadratic(series.trial, np.hstack([columns, columns - own @ taken, shared]))
        before, after, mixed = omega[:main, :main], omega[d : 2 * d, d : 2 * d], omega[d : 2 * d, 2 * d :]
        if run >= 0:  # what is known of the trial's own parameters
            mine, q = self.basis.per_run[run]
            behind = -q[mine >= self.problem.measured] @ taken
            after = after + behind.T @ behind
            mixed = mixed + behind.T @ self.basis.shared[mine[mine >= self.problem.measured]]
        score, inside, turn = columns.T @ self.residual[rows], columns.T @ shared, waves.loading.T
        along = np.zeros((0, 1 + 2 * shared.shape[1]))
        if main:
            shares, axes = linalg.eigh(after[:main, :main], before)
            axes = axes[:, shares > _LEFT] / np.sqrt(shares[shares > _LEFT])
            along = axes.T @ np.hstack([score[:main, None], mixed[:main], inside[:main]])
        return _Scores(
            score=turn @ score,
            power=np.sum((turn @ (columns.T @ columns)) * turn, axis=1),
            variance=np.sum((turn @ after) * turn, axis=1),
            mixed=turn @ mixed,
            inside=turn @ inside,
            energy=float(np.nansum(series.values**2)),
            samples=series.samples,
            along=along,
        )


def _test(trial: str, channel: str, name: str, scores: _Scores, spread: FloatArray) -> CrossCorrelation:
    """Return the test of one channel against one input."""
    scale = 1.0 / np.sqrt(np.maximum(scores.power * scores.energy, 1e-300))
    statistic, rank = scores.quadratic(spread)
    return CrossCorrelation(
        trial=trial,
        channel=channel,
        input=name,
        lag=LAG,
        value=scores.score * scale,
        band=np.asarray(stats.norm.isf(BAND / 2.0) * scores.deviations(spread) * scale),
        statistic=statistic,
        degrees_of_freedom=rank,
        p_value=float(stats.f.sf(statistic / rank, rank, max(scores.samples - rank, 1))) if rank else np.nan,
    )


@dataclass(frozen=True, eq=False)
class Lagged:
    """An input at all lags, basis loading (n, l).

    Attributes:
        basis: (n, d) orthonormal, strongest direction first.
        loading: (d, l).
        main: number of directions that matter, the first ones.
    """

    basis: FloatArray
    loading: FloatArray
    main: int


def lagged(problem: Problem, index: int, series: str, name: str) -> Lagged:
    """Return an input at all lags; before the start of a trial and after its end it goes on as there.

    There is no direction where no joint moves.

    Args:
        problem: has the trial.
        index: of the trial.
        series: where it is sampled: the name of a sensor, all samples; empty: the velocities, those that count.
        name: of the input.
    """
    trial = problem.trials[index]
    time = next((s.time for s in trial.sensors if s.name == series), trial.time[problem.mask(index)])
    motion = requested_motion(problem.model.fish.cpg, trial, STEP)
    moving = np.flatnonzero(np.ptp(motion.angle, axis=(0, 1)) > 0.0)
    values = np.zeros((len(time), len(LAG)))
    for first in range(0, len(time) if len(moving) else 0, _SAMPLES):
        rows = slice(first, first + _SAMPLES)
        when = np.clip(time[rows, None] - LAG, motion.time[0], motion.time[-1])
        values[rows] = INPUTS[name](motion.angle_at(when.ravel())[:, moving[-1]].reshape(when.shape))
    left, singular, right = tall_svd(values)
    kept, main = (int(np.count_nonzero((singular > share * singular[0]) & (singular > 0.0))) for share in (_ALL, _MAIN))
    return Lagged(left[:, :kept], singular[:kept, None] * right[:kept], main)


def background(residuals: Sequence[FloatArray], bases: Sequence[FloatArray], lost: float = 0.0) -> Autoregressive:
    """Estimate the noise of one channel of trials of one sampling rate, beside the span of a basis in each.

    Regressing residuals on a basis B takes the lines out, but also the noise that was there; a notch is left. Its noise
    is put back as the model expects it, and model and notch are brought to agree: with P = I - B B', the
    autocovariances are those of

        E[v v' | P v] = P v v' P + B (B' S B) B',     S the covariance of the model so far

    (an EM step that drops what P v says of B'v, [Dempster1977]). The Yule-Walker equations then give the next model.

    Args:
        residuals: (m,) a trial, on a grid of equal intervals, NaN in gaps.
        bases: (m, d) orthonormal, zero in the gaps.
        lost: further degrees of freedom that a fit took.
    """
    total = sum(int(np.isfinite(series).sum()) for series in residuals)
    highest = highest_order([len(series) for series in residuals])
    cleared = [
        ((e := np.nan_to_num(series)) - basis @ (basis.T @ e))[:, None]
        for series, basis in zip(residuals, bases, strict=True)
    ]
    products, taken = lagged_products(cleared, highest), np.zeros(highest + 1)
    for _ in range(_ROUNDS):
        noise = by_order((products + taken) / max(total - lost, 0.1 * total), total)
        taken = np.sum([_expected(noise, basis, highest) for basis in bases], axis=0)
    return noise


def _expected(noise: Autoregressive, basis: FloatArray, highest: int) -> FloatArray:
    """Return the lagged products (highest + 1,) that the noise has in the span of a basis."""
    shaped = coloured(noise, basis)
    spread = basis @ (shaped.T @ shaped)
    return np.array([np.sum(spread[k:] * basis[: len(basis) - k]) for k in range(highest + 1)])


def coloured(noise: Autoregressive, columns: FloatArray) -> FloatArray:
    """Return sigma A^-T u of columns u (m, d): the noise filter backwards in time, on past the first sample.

    The product of two of them is u' S u, S the covariance of the noise of one channel.
    """
    if noise.order == 0:
        return np.asarray(noise.sigma[0] * columns)
    longer = np.concatenate([np.zeros((_MEMORY, columns.shape[1])), columns])
    return np.asarray(signal.lfilter(noise.sigma[:1], [1.0, *-noise.phi[0]], longer[::-1], axis=0))


Status = Literal["passed", "coloured", "dependent", "untested"]
#: A residual whose p value is below this fails.
LEVEL = 0.01


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Whether anything is left in the residual.

    Attributes:
        whiteness: per channel, every trial and then all.
        independence: per channel and input, every trial and then all.
        p_white: chance of the least white channel, over all trials, if all are: the smallest p value times how many
            there are.
        p_independent: the same of the channels and inputs.
        status: ``passed``; ``coloured`` (independent of the input, not white: intervals that assume white noise are too
            narrow, the model may be right), ``dependent`` (the model misses something that the drive does) or
            ``untested`` (the fit diverged or failed, or no run is long enough).
    """

    whiteness: tuple[Autocorrelation, ...]
    independence: tuple[CrossCorrelation, ...]
    p_white: float
    p_independent: float
    status: Status


def residual_tests(problem: Problem, fit: Fit, *, lags: int = LAGS) -> ResidualTests:
    """Test the residuals of a fit, of the velocities and of every sensor.

    Args:
        problem: that was fitted.
        fit: of it.
        lags: of the test of whiteness.
    """
    if fit.lost:
        return ResidualTests((), (), np.nan, np.nan, "untested")
    series = series_of(problem, serial_blocks(problem, fit.residual))
    white, independent = whiteness(series, problem.noise.order, lags=lags), independence(problem, fit, series)
    p_white, p_independent = _least(white), _least(independent)
    status: Status = "dependent" if p_independent < LEVEL else "coloured" if p_white < LEVEL else "passed"
    if not white or not independent:
        status = "untested"
    return ResidualTests(white, independent, p_white, p_independent, status)


def _least(tests: Sequence[Autocorrelation] | Sequence[CrossCorrelation]) -> float:
    """Return the smallest p value over all trials, times how many there are (Bonferroni); NaN without any."""
    found = [test.p_value for test in tests if test.trial == ALL and np.isfinite(test.p_value)]
    return min(1.0, len(found) * min(found)) if found else np.nan
