"""How the velocities were made: the spectrum of what is left of them says whether positions were differentiated.

Positions with white noise, differentiated, leave noise that rises with frequency; a Savitzky-Golay filter of m samples
bends it down again, with zeros that show m. Each is a spectrum S(f) = a |H(f)|^2 + b, and the best by Whittle's
likelihood, - sum log S + I / S over the periodogram I, is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from mjfish.arrays import FloatArray
from mjfish.frames import CHANNELS
from mjfish.inspection.finding import Finding

#: Windows of Savitzky-Golay filters that are tried, and the orders of their polynomials that differ.
_WINDOWS = (3, 5, 7, 9, 11, 13, 15, 17, 21, 25, 31)
_FILTERS = tuple((window, order) for window in _WINDOWS for order in (2, 4) if window > order)
#: Shares of white noise beside the filtered.
_WHITE = (0.0, 1e-4, 1e-3, 1e-2, 0.05, 0.2)
#: Log-likelihood by which a way of making must beat all others of another kind.
_CLEAR = 20.0


@dataclass(frozen=True)
class Making:
    """The best account of a channel's noise.

    Attributes:
        channel: its name.
        kind: ``white``, ``differentiated``, ``drifting`` (autoregressive of order 1 to 3), or ``unclear``.
        window: samples of the filter, where it was differentiated; 0 else.
        order: of the filter's polynomial.
    """

    channel: str
    kind: str
    window: int = 0
    order: int = 0


def making(
    residuals: Sequence[FloatArray], intervals: Sequence[float], beats: Sequence[Sequence[float]]
) -> list[Making]:
    """Say how the velocities were made, channel by channel.

    Args:
        residuals: (n, 3) a trial, at equal intervals, without gaps.
        intervals: between samples [s].
        beats: frequencies [Hz] of the beats of each trial: lines beside them and their harmonics are left out.
    """
    found = []
    shapes: dict[tuple[int, int], FloatArray] = {}
    for channel, name in enumerate(CHANNELS):
        waves = [_periodogram(r[:, channel], dt, f) for r, dt, f in zip(residuals, intervals, beats, strict=True)]
        phase, power = (np.concatenate(parts) for parts in zip(*waves, strict=True)) if waves else (np.zeros(0),) * 2
        if not shapes:  # the phases are those of every channel
            shapes.update({key: _differentiated(phase, *key) for key in _FILTERS})
        found.append(_best(name, phase, power, shapes))
    return found


def remarks(found: Sequence[Making]) -> Iterator[Finding]:
    """Say it in a remark, one for channels that were made alike."""
    for kind, window, order in dict.fromkeys((one.kind, one.window, one.order) for one in found):
        if kind != "differentiated":
            continue
        names = tuple(one.channel for one in found if (one.kind, one.window, one.order) == (kind, window, order))
        yield Finding(
            "making",
            "remark",
            " and ".join(names),
            f"the noise has the spectrum of differentiated positions, smoothed by a filter of {window} samples "
            f"(Savitzky-Golay, order {order}, or like it)",
            "noise of a velocity that was measured",
            "fit with coloured noise; the filter also delays and rounds what it smooths, so give the positions if you "
            "can; a filter that is not centred looks like a clock offset of half its length",
            cannot_tell=("time_offset",),
            channels=names,
        )


def _periodogram(values: FloatArray, interval: float, beats: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return phases (m,) [rad a sample] and powers (m,) away from zero and from the harmonics of the beat."""
    frequency, power = signal.periodogram(values, 1.0 / interval, window="hann", detrend="constant")
    keep = frequency > 3.0 / (len(values) * interval)
    wide = max(0.35, 2.5 / (len(values) * interval))  # a line is two of 1 / duration wide to either side
    for beat in beats:
        for harmonic in range(1, int(0.5 / (interval * beat)) + 1):
            keep &= np.abs(frequency - harmonic * beat) > wide
    keep[-1] = False
    return 2.0 * np.pi * frequency[keep] * interval, power[keep]


def _best(name: str, phase: FloatArray, power: FloatArray, shapes: Mapping[tuple[int, int], FloatArray]) -> Making:
    if len(phase) < 60 or not np.all(power > 0.0):
        return Making(name, "unclear")
    # Each kind by its likelihood less what its parameters cost; Hann windows leave about two thirds of the freedom.
    cost = 0.5 * np.log(len(phase))
    derived = {key: max(_whittle(power, one, w) for w in _WHITE) - 2.0 * cost for key, one in shapes.items()}
    best = max(derived, key=lambda key: derived[key])
    kinds = {"white": _whittle(power, np.ones_like(phase), 0.0), "drifting": _autoregressive(phase, power, cost)}
    kinds["differentiated"] = derived[best]
    kind = max(kinds, key=lambda key: kinds[key])
    if kind == "differentiated":
        clear = kinds[kind] - max(kinds["white"], kinds["drifting"]) > _CLEAR
        return Making(name, kind, *best) if clear else Making(name, "unclear")
    return Making(name, kind)


def _whittle(power: FloatArray, shape: FloatArray, white: float) -> float:
    """Return the likelihood of a spectrum of this shape with a share of white noise, its level profiled out."""
    spectrum = shape / shape.mean() + white
    level = float(np.mean(power / spectrum))
    return float(-np.sum(np.log(level * spectrum)) - len(power))


def _differentiated(phase: FloatArray, window: int, order: int) -> FloatArray:
    weights = signal.savgol_coeffs(window, order, deriv=1)
    half = window // 2  # odd: a sum of sines
    return np.asarray((np.sin(phase[:, None] * np.arange(1, half + 1)) @ (2.0 * weights[half + 1 :])) ** 2 + 1e-12)


def _autoregressive(phase: FloatArray, power: FloatArray, cost: float) -> float:
    """Return the best likelihood of autoregressive spectra of order 1 to 3 with a share of white noise."""
    best = -np.inf
    lags = np.arange(4)
    covariance = np.cos(phase[:, None] * lags).T @ power
    for order in (1, 2, 3):
        toeplitz = covariance[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
        phi = np.linalg.lstsq(toeplitz, covariance[1 : order + 1])[0]
        response = np.abs(1.0 - np.exp(-1j * phase[:, None] * lags[1 : order + 1]) @ phi) ** 2
        best = max(best, max(_whittle(power, 1.0 / response, w) for w in _WHITE) - (order + 1) * cost)
    for pole in (0.8, 0.9, 0.95, 0.98, 0.99):
        shape = 1.0 / np.abs(1.0 - pole * np.exp(-1j * phase)) ** 2
        best = max(best, max(_whittle(power, shape, w) for w in (*_WHITE, 0.5, 1.0, 2.0)) - 2.0 * cost)
    return float(best)
