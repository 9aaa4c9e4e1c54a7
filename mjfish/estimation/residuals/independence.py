r"""Is the residual independent of the input? Cross-correlation with the joint command, with the variance it really has.

The input u is the command of the last joint that moves, or its square: the first turns with the beat, the second twice
a beat about a mean, as sway and surge do. The covariance of the residual e with u at lag tau,
r(tau) = sum_t e_t u(t - tau), has, if they are independent, the variance

    var r(tau) = sum_{t,s} u(t - tau) R_e(t - s) u(s - tau) = N sum_k R_e(k) R_u(k)        [Ljung1999], eq. (16.70)

The input is periodic: R_u does not decay, and neither do the correlations between the r(tau) at different lags. So

- the sum is done in full, as sigma^2 |A^-T u|^2 with A the autoregressive noise model of the residual, which is
  estimated after everything in the span of the lagged inputs is taken out: a line of the input in the residual would
  else pass for noise and hide itself;
- what the fit has taken is taken out of u, too: with J the sensitivities and W the weights, the residual of noise v is
  e = (I - J (J'W J)^-1 J'W) v, so that e'u = v'u~ with u~ = u - W J (J'W J)^-1 J'u. Sensitivities are locked to the
  beat as well: without this, the test of a fitted residual would speak too seldom;
- the p value is of all lags jointly: in an orthonormal basis of the lagged inputs (two directions for each frequency
  of the drive), the quadratic form of the inverse covariance, over its freedom F-distributed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats

from mjfish.arrays import FloatArray
from mjfish.estimation.noise import Noise
from mjfish.estimation.residuals.absorbed import Absorbed
from mjfish.estimation.residuals.background import background, coloured
from mjfish.estimation.residuals.inputs import INPUTS, Lagged, lagged
from mjfish.estimation.residuals.plain import Plain
from mjfish.estimation.residuals.residual import Residual
from mjfish.estimation.residuals.whiteness import ALL, BAND
from mjfish.fish import Cpg
from mjfish.frames import CHANNELS

#: Directions of which the fit has left less than this share of their variance are not tested.
_LEFT = 0.05


@dataclass(frozen=True, eq=False)
class CrossCorrelation(Plain):
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
        freedom: number of directions.
        p_value: of the statistic; NaN where the fit has taken every direction, or no joint moves.
    """

    trial: str
    channel: str
    input: str
    lag: FloatArray
    value: FloatArray
    band: FloatArray
    statistic: float
    freedom: int
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
    left = [_complete(residual) for residual in residuals]
    found = []
    for channel in range(len(CHANNELS)):
        for name in INPUTS:
            found += _of(channel, name, residuals, left, designs[name], noises, absorbed)
    return tuple(found)


def _complete(residual: Residual) -> FloatArray:
    """Return residuals (n, 3), zero where any channel is missing or the sample does not count."""
    return np.where(np.all(np.isfinite(residual.values), axis=1)[:, None], residual.values, 0.0)


def _background(
    residuals: Sequence[Residual], designs: dict[str, list[Lagged]], absorbed: Absorbed | None
) -> list[Noise]:
    """Estimate the noise beside the lines of the inputs, one model for all trials of a sampling rate."""
    grids, bases = [], []
    for r, residual in enumerate(residuals):
        main = [designs[name][r].basis[:, : designs[name][r].main] for name in INPUTS]
        joined = np.concatenate(main, axis=1)
        bases.append(np.nan_to_num(residual.on_grid(linalg.orth(joined) if joined.shape[1] else joined)))
        grids.append(residual.on_grid(residual.values))
    lost = 0.0 if absorbed is None else absorbed.left.shape[1] / (len(CHANNELS) * len(residuals))
    rates = [tuple(bool(np.isclose(a.trial.step, b.trial.step, rtol=0.01)) for b in residuals) for a in residuals]
    found: dict[tuple[bool, ...], Noise] = {}
    for alike in rates:
        if alike not in found:
            members = np.flatnonzero(alike)
            own = [grids[k] for k in members], [bases[k] for k in members]
            found[alike] = background(*own, lost * len(members))
    return [found[alike] for alike in rates]


def _of(
    channel: int,
    name: str,
    residuals: Sequence[Residual],
    left: list[FloatArray],
    designs: list[Lagged],
    noises: list[Noise],
    absorbed: Absorbed | None,
) -> list[CrossCorrelation]:
    """Return the tests of one channel against one input: of every trial, then of all."""
    columns = _columns(channel, left, designs)
    still = columns[0].shape[2] == 0
    clear = columns if absorbed is None or still else absorbed.clear(columns)
    sums = _Sums(
        score=np.sum([np.einsum("ncd,nc->d", block, e) for block, e in zip(clear, left, strict=True)], axis=0),
        before=_covariance(columns, residuals, noises),
        after=_covariance(clear, residuals, noises),
        energy=np.array([float(e[:, channel] @ e[:, channel]) for e in left]),
        samples=sum(int(np.count_nonzero(e[:, channel])) for e in left),
    )
    every = range(len(residuals))
    named = [(residuals[k].trial.name, [k]) for k in every] + [(ALL, list(every))]
    return [_test(trial, CHANNELS[channel], name, members, designs, sums) for trial, members in named]


@dataclass(frozen=True, eq=False)
class _Sums:
    """Products of the basis of all trials with the residual, and their covariance before and after the fit."""

    score: FloatArray
    before: FloatArray
    after: FloatArray
    energy: FloatArray
    samples: int


def _test(
    trial: str, channel: str, name: str, members: list[int], designs: list[Lagged], sums: _Sums
) -> CrossCorrelation:
    """Return the test of some trials jointly, and the correlation of their sum."""
    first = np.cumsum([0, *(design.basis.shape[1] for design in designs)])
    every = np.concatenate([np.arange(first[k], first[k + 1]) for k in members])
    main = np.concatenate([np.arange(first[k], first[k] + designs[k].main) for k in members])
    loading = np.concatenate([designs[k].loading for k in members])
    variance = np.einsum("il,ij,jl->l", loading, sums.after[np.ix_(every, every)], loading)
    power = np.sum([designs[k].power for k in members], axis=0) * np.sum(sums.energy[members])
    scale = 1.0 / np.sqrt(np.maximum(power, 1e-300))
    statistic, freedom = _quadratic(sums.score[main], sums.before[np.ix_(main, main)], sums.after[np.ix_(main, main)])
    spare = max(sums.samples - len(sums.score), 1)
    return CrossCorrelation(
        trial=trial,
        channel=channel,
        input=name,
        lag=designs[0].lag,
        value=loading.T @ sums.score[every] * scale,
        band=np.asarray(stats.norm.isf(BAND / 2.0) * np.sqrt(np.maximum(variance, 0.0)) * scale),
        statistic=statistic,
        freedom=freedom,
        p_value=float(stats.f.sf(statistic / freedom, freedom, spare)) if freedom else np.nan,
    )


def _columns(channel: int, left: list[FloatArray], designs: list[Lagged]) -> list[FloatArray]:
    """Return the bases of all trials as columns (n_r, 3, d) a trial, each zero outside its trial and the channel."""
    total = sum(design.basis.shape[1] for design in designs)
    blocks, first = [], 0
    for e, design in zip(left, designs, strict=True):
        block = np.zeros((*e.shape, total))
        block[:, channel, first : first + design.basis.shape[1]] = design.basis
        blocks.append(block)
        first += design.basis.shape[1]
    return blocks


def _covariance(columns: list[FloatArray], residuals: Sequence[Residual], noises: list[Noise]) -> FloatArray:
    """Return the covariance (d, d) of the columns' products with the noise: sigma^2 (A^-T u)' (A^-T u), summed."""
    total = np.zeros((columns[0].shape[2],) * 2)
    for block, residual, noise in zip(columns, residuals, noises, strict=True):
        grid = np.nan_to_num(residual.on_grid(block))
        for channel in range(len(CHANNELS)):
            shaped = coloured(noise, channel, grid[:, channel])
            total += shaped.T @ shaped
    return total


def _quadratic(score: FloatArray, before: FloatArray, after: FloatArray) -> tuple[float, int]:
    """Return score' after^+ score and its rank, without directions that the fit has taken."""
    if not len(score):
        return 0.0, 0
    shares, directions = linalg.eigh(after, before)
    kept = shares > _LEFT
    along = directions[:, kept].T @ score
    return float(np.sum(along**2 / shares[kept])), int(np.count_nonzero(kept))
