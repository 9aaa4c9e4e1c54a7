"""The fingerprint of what a named cause leaves: its exponent of frequency, and the symmetry that it breaks.

This is a picture for the reader; no verdict rests on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from mjfish.arrays import FloatArray, checked
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.estimation import Problem
from mjfish.estimation.omnibus import beat_phase

HARMONICS = 3
#: Beats that a stretch must last, and beats after a start or step that are not steady yet.
_LASTING, _SETTLING = 2.0, 3.0
#: Frequencies closer than this share are one.
_APART = 0.05


@dataclass(frozen=True)
class Measured:
    """The fingerprint of a discrepancy.

    Attributes:
        exponent: q with its 95 % interval `low`, `high`; None where the steady straight stretches have one frequency.
        low, high: of the interval.
        odd: share of the steady discrepancy's energy that breaks the glide reflection, None without such a stretch.
        odd_p: p value of that part, were the world left-right symmetric.
        predicted: of the causes, where it is one cause.
    """

    exponent: float | None
    low: float | None
    high: float | None
    odd: float | None
    odd_p: float | None
    predicted: Fingerprint


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Harmonics of one steady stretch: frequency [Hz], coefficients in units of their standard errors and raw."""

    frequency: float
    kept: FloatArray
    broken: FloatArray
    size: float
    error: float


def fingerprint(problem: Problem, causes: Sequence[Effect], values: Mapping[str, float]) -> Measured:
    """Return the fingerprint of what the causes in a problem add, at its estimates by name.

    It is taken from y - eta(theta, 0), the measurement less the prediction of the extended model with its causes
    switched off: refitted coefficients alone would have hidden most of it. Harmonics of the beat are regressed on each
    channel c of every steady, straight stretch:

        r_c(t) = sum_h a_ch cos h phi + b_ch sin h phi,   h = 0..3

    The nominal model keeps the glide reflection (surge, sway, yaw rate)(t + T/2) = (surge, -sway, -yaw rate)(t): its
    surge has even harmonics, its sway and yaw rate odd ones; all others are odd under it. By its time scaling,
    velocities over f L are the same at all frequencies f. A discrepancy ~ f^q shows as the slope q of
    log |r| / f over log f.
    """
    x = problem.start({**values, **{p.name: p.default for effect in causes for p in effect.amplitudes()}})
    stretches = [s for i, raw in enumerate(problem.raw(x)) for s in _stretches(problem, i, raw)]
    exponent, low, high = _exponent(stretches)
    odd, odd_p = _parity(stretches)
    return Measured(exponent, low, high, odd, odd_p, causes[0].fingerprint if len(causes) == 1 else Fingerprint())


def _stretches(problem: Problem, index: int, raw: FloatArray) -> list[_Stretch]:
    trial = problem.trials[index]
    if trial.joint_angle is not None:
        return []
    mask, phase = problem.mask(index), beat_phase(problem.model.fish.cpg, trial)
    edges = [*(segment.start for segment in trial.drive), float(trial.time[-1])]
    found = []
    for segment, end in zip(trial.drive, edges[1:], strict=True):
        beat = 2.0 * np.pi / segment.omega if segment.omega > 0.0 else np.inf
        here = (trial.time >= segment.start + _SETTLING * beat) & (trial.time <= end)
        if any(segment.bias) or np.count_nonzero(here) * trial.step < _LASTING * beat:
            continue
        rows = here[mask]
        turned = phase[mask][rows]
        frequency = float(np.polyfit(trial.time[mask][rows], turned, 1)[0]) / (2.0 * np.pi)
        found.append(_harmonics(abs(frequency), turned, raw[rows], problem.noise.sigma))
    return found


def _harmonics(frequency: float, phase: FloatArray, raw: FloatArray, sigma: FloatArray) -> _Stretch:
    """Regress harmonics on a stretch; errors from what they leave, in units of sigma of each channel."""
    waves = [np.ones_like(phase)]
    for h in range(1, HARMONICS + 1):
        waves += [np.cos(h * phase), np.sin(h * phase)]
    design = np.stack(waves, axis=1)
    order = np.array([0, *(h for h in range(1, HARMONICS + 1) for _ in range(2))])
    coefficients, *_ = np.linalg.lstsq(design, raw, rcond=None)
    left = raw - design @ checked(coefficients)
    spread = checked(np.linalg.inv(design.T @ design))
    memory = 1.0 + 2.0 * np.maximum(np.sum(left[1:] * left[:-1], axis=0) / np.sum(left**2, axis=0), 0.0)
    variance = np.sum(left**2, axis=0) / max(len(phase) - len(order), 1) * memory
    errors = np.sqrt(np.diag(spread)[:, None] * variance)
    scaled = coefficients / errors
    even = order % 2 == 0
    kept = np.concatenate([scaled[even, 0], scaled[~even, 1], scaled[~even, 2]])
    broken = np.concatenate([scaled[~even, 0], scaled[even, 1], scaled[even, 2]])
    unit = coefficients / sigma
    noise = float(np.sum((errors / sigma) ** 2))
    power = float(np.sum(unit**2)) - noise
    error = float(np.sqrt(np.sum(4.0 * unit**2 * (errors / sigma) ** 2))) / 2.0 / np.sqrt(max(power, noise))
    return _Stretch(frequency, kept, broken, float(np.sqrt(max(power, 0.0))), error)


def _exponent(stretches: Sequence[_Stretch]) -> tuple[float | None, float | None, float | None]:
    seen = [s for s in stretches if s.size > 3.0 * s.error]
    frequencies = np.array([s.frequency for s in seen])
    if len(seen) < 2 or np.ptp(frequencies) < _APART * frequencies.mean():
        return None, None, None
    x, y = np.log(frequencies), np.log([s.size / s.frequency for s in seen])
    errors = np.array([s.error / s.size for s in seen])
    line, covariance = optimize.curve_fit(lambda f, a, q: a + q * f, x, y, sigma=errors, absolute_sigma=True)
    left = (y - checked(line)[0] - line[1] * x) / errors
    inflate = max(1.0, float(left @ left) / max(len(seen) - 2, 1))
    half = stats.norm.ppf(0.975) * float(np.sqrt(covariance[1, 1] * inflate))
    return float(line[1]), float(line[1]) - half, float(line[1]) + half


def _parity(stretches: Sequence[_Stretch]) -> tuple[float | None, float | None]:
    if not stretches:
        return None, None
    kept, broken = (np.concatenate([getattr(s, side) for s in stretches]) for side in ("kept", "broken"))
    even, odd = (max(float(part @ part) - len(part), 0.0) for part in (kept, broken))
    share = odd / (odd + even) if odd + even > 0.0 else 0.0
    return share, float(stats.chi2.sf(float(broken @ broken), len(broken)))
