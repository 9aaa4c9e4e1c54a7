"""Whether what was taken for noise can be noise: a misfit may be slow, or come in bursts.

- `too_large`: coloured noise that is as large as a part of the motion. A misfit that is slow enough looks like it.
- `bursts`: noise that is larger at one moment than at another. A camera's is not; a jerk is.

[McLeod1983] A. McLeod and W. Li, Journal of Time Series Analysis 4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from mjfish.diagnosis.evidence import Evidence
from mjfish.estimation import Fit, Noise, Problem
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection import Finding, Repeats
from mjfish.noise import Autoregressive, GaussMarkov, ProcessNoise
from mjfish.numerics.arrays import FloatArray, checked

#: Share of a channel, both rms, up to which slow noise is believed; of cameras over a tank it is a few hundredths.
_LARGEST = 0.06
#: Slow is what a mean over this time leaves [s].
_SLOW = 0.2
#: Share of it that repeated runs must show, for it to be noise all the same.
_REPEATED = 0.7


def too_large(problem: Problem, fit: Fit, repeats: Repeats | None) -> Finding | None:
    """Return the finding that noise which has a colour is as large as a part of the motion; None where it is not.

    Its estimate takes for noise whatever the candidates do not explain: nothing may seem wrong with a simulation that
    is far off. Repeated runs tell them apart, for noise differs between them and a misfit does not.

    Args:
        problem: of the nominal model, with the noise that was found.
        fit: its result.
        repeats: the noise that repeated runs show, if any were.
    """
    if not _slow(problem.noise):
        return None
    moves = np.concatenate([trial.velocity[problem.mask(i)] for i, trial in enumerate(problem.trials)])
    width = max(round(_SLOW / problem.trials[0].step), 1)
    slow = np.concatenate([ndimage.uniform_filter1d(series, width, axis=0) for series in problem.raw(fit.x)])
    error, size = (np.sqrt(np.mean(series**2, axis=0)) for series in (slow, moves))
    large = error > _LARGEST * size
    if repeats is not None:
        large &= repeats.sigma < _REPEATED * error
    if not large.any():
        return None
    worst = int(np.argmax(np.where(large, error / np.maximum(size, 1e-12), 0.0)))
    channel, share = CHANNELS[worst], error[worst] / size[worst]
    off = f"{error[worst]:.2g} {UNITS[channel]} rms over {_SLOW} s and more"
    return Finding(
        code="noise-slow",
        severity="blocks",
        place=channel,
        found=f"the simulation is off by {off}, {share:.0%} of the measured rms; that may be noise, or something "
        "that no known cause explains",
        expected=f"slow noise of at most {_LARGEST:.0%}",
        remedy="swim one drive twice or more: noise differs between repeats, an effect does not",
        channels=tuple(name for name, series in zip(CHANNELS, large, strict=True) if series),
    )


def _slow(noise: Noise) -> bool:
    """Return whether a noise is slow enough that a misfit could pass for it: not white, nor that of differentiation."""
    return isinstance(noise, GaussMarkov | ProcessNoise) or (isinstance(noise, Autoregressive) and noise.order > 0)


#: Length of a window [s]: that of a jerk, below that of a beat.
_WINDOW = 0.2
#: c, in standard deviations.
_CUT = 3.0
#: Orders that are drawn.
_DRAWS = 400
#: What must be reached by the standard deviations by which the measured order stands out, and the standard errors by
#: which two channels go together, of which no more than half counts.
_STANDS_OUT, _TOGETHER = 7.0, 3.5
#: Mean square of the whitened residual below which it is smaller than any noise: errors of the integration, say.
_QUIET = 0.25
#: How many bursts are listed.
_LISTED = 3


def bursts(evidence: Evidence) -> Finding | None:
    """Return the finding that what was taken for noise comes in bursts; None where it does not.

    The whitened residual z, in the direction e in which its channels vary most, has in window k the energy

        E_k = sum of min((e' z_i)^2, c^2) over the samples i of window k

    The cut c limits single samples of heavy tails. ln var E is compared with that of the same samples in shuffled
    order, run by run; tails and correlation between channels are in both. [McLeod1983] tests the autocorrelation of
    squares for this; sums over the length of a jerk have more power. Forces on the fish move channels together, sway
    and yaw rate above all; noise of a camera seldom does.
    """
    problem = evidence.problem
    runs = [evidence.cleared[rows].reshape(-1, 3) for rows in evidence.problem.rows_by_trial()]
    widths = [max(round(_WINDOW / trial.step), 2) for trial in problem.trials]
    if any(len(run) <= width for run, width in zip(runs, widths, strict=True)) or np.mean(evidence.cleared**2) < _QUIET:
        return None
    if not stand_out(burstiness(runs, widths), coincidence(runs)):
        return None
    ahead = leading(runs)
    energies = [_energy(run, width) / width for run, width in zip(ahead, widths, strict=True)]
    places = []
    for _ in range(_LISTED):
        i = int(np.argmax([energy.max() for energy in energies]))
        k = int(np.argmax(energies[i]))
        time = problem.trials[i].time[problem.mask(i)][k + widths[i] // 2]
        places.append(f"{problem.trials[i].name} at {time:.1f} s")
        energies[i][max(k - widths[i], 0) : k + widths[i] + 1] = 0.0
    return Finding(
        code="noise-bursts",
        severity="blocks",
        place=", ".join(places),
        found="the simulation is off at single moments, by more than noise",
        expected="noise of one size throughout",
        remedy="watch the film there: a sticking joint, a collision or a lost marker looks like this",
    )


def stand_out(bursty: float, together: float) -> bool:
    """Return whether bursts are more than chance, by `burstiness` and `coincidence`."""
    return bursty + min(together, _TOGETHER) > _STANDS_OUT


def coincidence(runs: Sequence[FloatArray]) -> float:
    """Return the largest correlation between two channels of whitened residuals (n_r, 3), in standard errors."""
    every = np.concatenate(runs)
    return float(np.sqrt(len(every)) * np.max(np.abs(np.triu(np.corrcoef(every.T), 1))))


def leading(runs: Sequence[FloatArray]) -> list[FloatArray]:
    """Return (n_r,) of every run, the whitened residuals (n_r, 3) in the direction in which they vary the most."""
    scaled = [run / np.sqrt(np.mean(run**2, axis=0)) for run in runs]
    every = np.concatenate(scaled)
    _, directions = np.linalg.eigh(every.T @ every)
    return [run @ checked(directions)[:, -1] for run in scaled]


def burstiness(runs: Sequence[FloatArray], widths: Sequence[int]) -> float:
    """Return by how many standard deviations ln var E is above that of shuffled runs.

    Args:
        runs: (n_r, 3) whitened residual of every run.
        widths: samples in a window, of every run.
    """
    ahead = leading(runs)
    seen = _unequal(ahead, widths)
    rng = np.random.default_rng(0)
    drawn = [_unequal([rng.permutation(run) for run in ahead], widths) for _ in range(_DRAWS)]
    return float((seen - np.mean(drawn)) / np.std(drawn))


def _unequal(runs: Sequence[FloatArray], widths: Sequence[int]) -> float:
    energies = [_energy(run, width) for run, width in zip(runs, widths, strict=True)]
    return float(np.log(np.var(np.concatenate(energies))))


def _energy(run: FloatArray, width: int) -> FloatArray:
    """Return E (n - width + 1,) of one run (n,)."""
    return np.asarray(sliding_window_view(np.minimum(run**2, _CUT**2), width).sum(axis=1))
