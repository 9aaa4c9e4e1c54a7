"""Channels of the wrong sign, unit or name: each is a hypothesis, held against the nominal simulation.

The correlation of measured channel a and simulated channel b, uncentred,

    K_ab = sum_t y_a p_b / sqrt(sum_t y_a^2 sum_t p_b^2)

is near 1 on the diagonal whatever the coefficients, for the joints force the head to recoil; a flipped channel has -1.
servo's lag or a clock turns phases, so every hypothesis may shift the clock by up to 0.06 s.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.frames import CHANNELS
from mjfish.inspection.finding import EVERYTHING, Finding
from mjfish.inspection.guess import Guess

#: By how much (of 3) a hypothesis must correlate better than the channels as they are, and how well at least.
MARGIN = 0.6
_GOOD = 2.4
#: Sizes, measured over simulated, of channels in another unit; a size must be this factor nearer to it than to 1.
_UNITS = {
    1000.0: "it is in mm/s; multiply by 0.001",
    100.0: "it is in cm/s; multiply by 0.01",
    0.001: "it is in km/s or was divided twice; multiply by 1000",
    0.01: "multiply by 100",
}
_ANGULAR = {
    180.0 / np.pi: "it is in deg/s; multiply by pi/180",
    np.pi / 180.0: "it was turned into radians twice; multiply by 180/pi",
    1.0 / (2.0 * np.pi): "it is in turns a second; multiply by 2 pi",
}
#: A channel this many times larger or smaller than simulated is in another unit.
_STRANGE = 12.0
_NEAR = 3.0


@dataclass(frozen=True)
class Reading:
    """How the channels of a trial may have to be read.

    Attributes:
        swapped: surge and sway are in each other's place.
        signs: of surge, sway, yaw rate.
    """

    swapped: bool
    signs: tuple[int, int, int]


AS_IS = Reading(False, (1, 1, 1))
READINGS = tuple(
    Reading(swapped, (a, b, c)) for swapped in (False, True) for a, b, c in itertools.product((1, -1), repeat=3)
)


def scores(trial: Trial, guessed: Sequence[Guess | None]) -> dict[Reading, float]:
    """Return, for every reading, the sum of the three correlations with the best guess and clock; at most 3."""
    best = dict.fromkeys(READINGS, -3.0)
    for guess in guessed:
        if guess is None:
            continue
        products = np.einsum("ta,stb->sab", trial.velocity, guess.shifted)
        own = np.sqrt(np.sum(trial.velocity**2, axis=0)) + 1e-12
        theirs = np.sqrt(np.sum(guess.shifted**2, axis=1)) + 1e-12
        correlation = products / own[None, :, None] / theirs[:, None, :]
        for reading in READINGS:
            order = (1, 0, 2) if reading.swapped else (0, 1, 2)
            total = sum(reading.signs[c] * correlation[:, order[c], c] for c in range(3))
            best[reading] = max(best[reading], float(np.max(total)))
    return best


def signs(found: Mapping[str, dict[Reading, float]]) -> Iterator[Finding]:
    """Say which channels are read the wrong way, in all trials alike or in some.

    Args:
        found: `scores` by the trial's name.
    """
    wrong: dict[Reading, list[str]] = {}
    for name, score in found.items():
        best = max(score, key=lambda reading: score[reading])
        if best != AS_IS and score[best] > score[AS_IS] + MARGIN and score[best] > _GOOD:
            wrong.setdefault(best, []).append(name)
    for reading, names in wrong.items():
        everywhere = len(names) == len(found)
        place = (
            "all trials" if everywhere else f"trials {', '.join(names)}" if len(names) > 1 else f"trial '{names[0]}'"
        )
        own, better = (float(np.mean([found[n][r] for n in names])) / 3.0 for r in (AS_IS, reading))
        channels = _concerned(reading)
        yield Finding(
            "signs",
            "blocks",
            f"{place}, {' and '.join(channels)}",
            f"{_words(reading)}: so read, the mean correlation with the nominal simulation is {better:.2f}, as it "
            f"stands {own:.2f}",
            "surge forward, sway to port, yaw rate anticlockwise seen from above",
            _remedy(reading),
            cannot_tell=(EVERYTHING,),
            trials=() if everywhere else tuple(names),
            channels=channels,
        )


def units(sizes: Mapping[str, FloatArray]) -> Iterator[Finding]:
    """Say which channels are in another unit.

    Args:
        sizes: (3,) rms measured over rms simulated, by the trial's name.
    """
    for channel, name in enumerate(CHANNELS):
        known = _ANGULAR if name == "yaw_rate" else _UNITS
        strange = {
            trial: float(size[channel])
            for trial, size in sizes.items()
            if not 1.0 / _STRANGE < size[channel] < _STRANGE and size[channel] > 0.0
        }
        if not strange:
            continue
        size = float(np.median(list(strange.values())))
        factor = min(known, key=lambda f: abs(np.log(size / f)))
        near = abs(np.log(size / factor)) < np.log(_NEAR)
        everywhere = len(strange) == len(sizes)
        yield Finding(
            "signs",
            "blocks",
            f"{'all trials' if everywhere else 'trial ' + ', '.join(strange)}, {name}",
            f"it is {size:.3g} times as large as simulated",
            "a size within a factor of a few",
            known[factor] if near else "check the unit and the drive",
            cannot_tell=(EVERYTHING,),
            trials=() if everywhere else tuple(strange),
            channels=(name,),
        )


def size(trial: Trial, guessed: Sequence[Guess | None]) -> FloatArray | None:
    """Return rms measured over rms simulated (3,), with the guess that is nearest; None without a guess."""
    ratios = [
        np.sqrt(np.mean(trial.velocity**2, axis=0) / (np.mean(guess.velocity**2, axis=0) + 1e-24))
        for guess in guessed
        if guess is not None
    ]
    if not ratios:
        return None
    every = np.array(ratios)
    return np.asarray(every[np.argmin(np.abs(np.log(every + 1e-12)), axis=0), np.arange(3)])


def _concerned(reading: Reading) -> tuple[str, ...]:
    return tuple(
        name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0 or (reading.swapped and name != "yaw_rate")
    )


def _words(reading: Reading) -> str:
    flipped = [name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0]
    words = ["surge and sway are in each other's column"] if reading.swapped else []
    if flipped:
        words.append(f"{' and '.join(flipped)} {'has' if len(flipped) == 1 else 'have'} the wrong sign")
    return ", and ".join(words)


def _remedy(reading: Reading) -> str:
    if not reading.swapped and reading.signs == (1, -1, -1):
        return "multiply both by -1 (y to starboard, z down), or the joint angles and biases if those are mirrored"
    if not reading.swapped and reading.signs == (-1, -1, 1):
        return "multiply both by -1: x points to the tail"
    swap = "swap surge and sway" if reading.swapped else ""
    flip = " and ".join(name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0)
    return " and ".join(part for part in (swap, f"multiply {flip} by -1" if flip else "") if part)
