"""Trials against the nominal simulation, before any fit: units, signs and names of channels, labels, starts.

Coefficients that nobody fitted are good enough for these. The correlation of measured channel a and simulated channel
b, uncentred,

    K_ab = sum_t y_a p_b / sqrt(sum_t y_a^2 sum_t p_b^2)

is near 1 on the diagonal whatever the coefficients, because the joints force the head to recoil; a flipped channel has
-1. A run has the label of another run's drive where that drive explains it and its own does not:

    cost_ij = mean over channels of  min_a sum |y_i - a p_j|^2 / sum |y_i|^2,      a in [1/2, 2]

with p_j the swimming under drive j at the times of run i. Amplitudes are free where nothing was fitted yet; after a fit
a = 1, and the cost is in units of the noise.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mjfish.data import Trial
from mjfish.data.validation import beats
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import Finding, redriven, reread
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

#: Clock shifts that are tried [s]: a late servo or clock must not look like a wrong sign, nor half a beat like none.
_CLOCK_SHIFTS = np.arange(-6, 7) * 0.01
#: Fewest samples a beat in which a motion can be recognised.
_SAMPLES_A_BEAT = 5.0
#: A run of a CPG that lasts longer than this [s] is not simulated.
_LONGEST = 4.0 * 3600.0
#: Frequencies [Hz] between which recorded joints beat, of any fish.
_PLAUSIBLE = (0.03, 30.0)
#: By how much (of 3) a hypothesis must correlate better than the channels as they are, and how well at least.
_MARGIN = 0.6
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
_NEAR_UNIT = 3.0
#: Smallest amplitude a.
_LOW = 0.5
#: Two runs are swapped where, crossed over, both cost less than this share of what they cost as they are.
_SWAPPED = 0.5
#: One run has the wrong label where its own drive costs this much, and another's this share of it.
_FOREIGN = 0.4
_SHARE = 0.25
#: Fewest beats from which a frequency is read.
_BEATS = 5.0
#: A run is under way at its start where its first samples have this share of the later speed.
_MOVING = 0.5

Drive = tuple[DriveSegment, ...]


def sampled_enough(trial: Trial) -> bool:
    """Whether a CPG-driven trial has enough samples a beat, and not too long a time to simulate."""
    if not trial.drive:
        return True
    beat = 2.0 * np.pi / max(segment.omega for segment in trial.drive)
    return bool(trial.step * _SAMPLES_A_BEAT < beat and trial.time[-1] < _LONGEST)


def time_factor(trial: Trial) -> float:
    """Return by what the times must be multiplied to be in s: 0.001 or 1000 where only that is plausible, else 1."""
    if trial.drive:
        return 1.0 if sampled_enough(trial) or not sampled_enough(retimed(trial, 0.001)) else 0.001
    frequency = min(beats(trial), default=1.0) if trial.joint_angle is not None else 1.0
    low, high = _PLAUSIBLE
    return next((factor for factor in (1.0, 0.001, 1000.0) if low < frequency / factor < high), 1.0)


def retimed(trial: Trial, factor: float) -> Trial:
    """Return the trial with its times multiplied, without its sensors, which have clocks of their own."""
    return trial if factor == 1.0 else replace(trial, time=readonly(factor * trial.time), sensors=())


def value_sets(fish: Fish) -> tuple[dict[str, float], ...]:
    """Return the coefficients that are tried: the fish's own, and those a fit starts from."""
    own = dict(fish.values)
    starts = {p.name: p.start for p in fish.parameters}
    return (own,) if own == starts else (own, starts)


def guess(model: Model, trial: Trial, values: dict[str, float]) -> FloatArray | None:
    """Predict what a trial would have measured (s, n, 3) at trial.time + `_CLOCK_SHIFTS`; None after a divergence."""
    start = None if trial.starts_at_rest else trial.velocity[0]
    rollout = model.predict(replace(trial, pose=None), values, velocity=start).rollout
    if rollout.status != "ok":
        return None
    inside = np.clip(trial.time + _CLOCK_SHIFTS[:, None], rollout.time[0], rollout.time[-1])
    return np.stack([rollout.at(times)[:, :3] for times in inside])


def unshifted(guessed: FloatArray) -> FloatArray:
    """Return the velocities (n, 3) of a `guess` at the trial's own times."""
    return np.asarray(guessed[len(_CLOCK_SHIFTS) // 2])


@dataclass(frozen=True)
class Reading:
    """How the channels of a trial may have to be read.

    Attributes:
        swapped: surge and sway are in each other's place.
        signs: of surge, sway, yaw rate.
    """

    swapped: bool
    signs: tuple[int, int, int]

    @property
    def order(self) -> tuple[int, int, int]:
        """The column that each channel is in."""
        return (1, 0, 2) if self.swapped else (0, 1, 2)


AS_IS = Reading(False, (1, 1, 1))
READINGS = tuple(
    Reading(swapped, (a, b, c)) for swapped in (False, True) for a, b, c in itertools.product((1, -1), repeat=3)
)


def scores(trial: Trial, guessed: Sequence[FloatArray]) -> dict[Reading, float]:
    """Return, for every reading, the sum of the three correlations with the best guess and clock; at most 3."""
    best = dict.fromkeys(READINGS, -3.0)
    for shifted in guessed:
        products = np.einsum("ta,stb->sab", trial.velocity, shifted)
        own = np.sqrt(np.sum(trial.velocity**2, axis=0)) + 1e-12
        theirs = np.sqrt(np.sum(shifted**2, axis=1)) + 1e-12
        correlation = products / own[None, :, None] / theirs[:, None, :]
        for reading in READINGS:
            total = sum(reading.signs[c] * correlation[:, reading.order[c], c] for c in range(3))
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
        if best != AS_IS and score[best] > score[AS_IS] + _MARGIN and score[best] > _GOOD:
            wrong.setdefault(best, []).append(name)
    for reading, names in wrong.items():
        everywhere = len(names) == len(found)
        place = (
            "all trials" if everywhere else f"trials {', '.join(names)}" if len(names) > 1 else f"trial '{names[0]}'"
        )
        own, better = (float(np.mean([found[n][r] for n in names])) / 3.0 for r in (AS_IS, reading))
        channels = _concerned(reading)
        yield Finding(
            "signs-channel",
            "blocks",
            f"{place}, {' and '.join(channels)}",
            f"{_reading_words(reading)}: so read, the mean correlation with the nominal simulation is {better:.2f}, as "
            f"it stands {own:.2f}",
            "surge forward, sway to port, yaw rate anticlockwise seen from above",
            _reading_remedy(reading),
            trials=() if everywhere else tuple(names),
            channels=channels,
            corrected=partial(reread, trials=names, order=reading.order, factors=np.array(reading.signs)),
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
        near = abs(np.log(size / factor)) < np.log(_NEAR_UNIT)
        everywhere = len(strange) == len(sizes)
        factors = np.where(np.arange(len(CHANNELS)) == channel, 1.0 / factor, 1.0)
        yield Finding(
            "signs-unit",
            "blocks" if near else "suspect",  # far from any unit: a fish that hardly follows its drive is so, too
            f"{'all trials' if everywhere else 'trial ' + ', '.join(strange)}, {name}",
            f"it is {size:.3g} times as large as simulated",
            f"a size within a factor of {_STRANGE:g}",
            known[factor] if near else "check the unit and the drive",
            trials=() if everywhere else tuple(strange),
            channels=(name,),
            corrected=partial(reread, trials=[*strange], order=range(3), factors=factors),
        )


def size(trial: Trial, guessed: Sequence[FloatArray]) -> FloatArray:
    """Return rms measured over rms simulated (3,), with the guess that is nearest."""
    squares = np.array([np.mean(unshifted(shifted) ** 2, axis=0) for shifted in guessed])
    every = np.sqrt(np.mean(trial.velocity**2, axis=0) / (squares + 1e-24))
    return np.asarray(every[np.argmin(np.abs(np.log(every + 1e-12)), axis=0), np.arange(3)])


def _concerned(reading: Reading) -> tuple[str, ...]:
    return tuple(
        name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0 or (reading.swapped and name != "yaw_rate")
    )


def _reading_words(reading: Reading) -> str:
    flipped = [name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0]
    words = ["surge and sway are in each other's column"] if reading.swapped else []
    if flipped:
        words.append(f"{' and '.join(flipped)} {'has' if len(flipped) == 1 else 'have'} the wrong sign")
    return ", and ".join(words)


def _reading_remedy(reading: Reading) -> str:
    if not reading.swapped and reading.signs == (1, -1, -1):
        return "multiply both by -1 (y to starboard, z down), or the joint angles and biases if those are mirrored"
    if not reading.swapped and reading.signs == (-1, -1, 1):
        return "multiply both by -1: x points to the tail"
    swap = "swap surge and sway" if reading.swapped else ""
    flip = " and ".join(name for c, name in enumerate(CHANNELS) if reading.signs[c] < 0)
    return " and ".join(part for part in (swap, f"multiply {flip} by -1" if flip else "") if part)


def costs(
    model: Model,
    trials: Sequence[Trial],
    drives: Sequence[Drive],
    values: Mapping[str, float],
    sigma: FloatArray | None = None,
) -> FloatArray:
    """Return the costs (trials, drives); infinite where a rollout diverges or a trial's joints were measured.

    Args:
        model, values: that predict.
        trials: measured.
        drives: that may have been theirs.
        sigma: (3,) after a fit: then a = 1, and costs are mean squares of the misfit over sigma.
    """
    table = np.full((len(trials), len(drives)), np.inf)
    driven = [trial for trial in trials if trial.drive]
    if not driven:
        return table
    longest = max(driven, key=lambda trial: float(trial.time[-1]))
    for j, drive in enumerate(drives):
        blank = replace(longest, drive=drive, pose=None, time=readonly(longest.time[[0, -1]]))
        run = model.predict(blank, values)
        if run.status != "ok":
            continue
        for i, trial in enumerate(trials):
            if trial.drive:
                clock = model.prepare(trial, values).time
                predicted = run.rollout.at(np.clip(clock, 0.0, run.rollout.time[-1]))[:, :3]
                table[i, j] = _cost(trial.velocity, predicted, sigma)
    return table


def _cost(measured: FloatArray, predicted: FloatArray, sigma: FloatArray | None) -> float:
    if sigma is not None:
        return float(np.mean(((measured - predicted) / sigma) ** 2))
    amplitude = np.sum(measured * predicted, axis=0) / (np.sum(predicted**2, axis=0) + 1e-24)
    left = measured - np.clip(amplitude, _LOW, 1.0 / _LOW) * predicted
    return float(np.mean(np.sum(left**2, axis=0) / (np.sum(measured**2, axis=0) + 1e-24)))


def labels(
    trials: Sequence[Trial], drives: Sequence[Drive], table: FloatArray, *, fitted: bool = False
) -> Iterator[Finding]:
    """Find pairs of runs that changed places, and runs that swam another run's drive.

    Args:
        trials: (n,).
        drives: (m,) distinct.
        table: (n, m) `costs`.
        fitted: they are in units of the noise.
    """
    own = [drives.index(trial.drive) if trial.drive in drives else -1 for trial in trials]
    taken: set[int] = set()
    for gain, i, j in sorted(_pairs(table, own)):
        if i in taken or j in taken:
            continue
        taken |= {i, j}
        here, there = (np.sqrt(table[i, own[k]]) for k in (i, j))
        yield Finding(
            "labels-swapped",
            "blocks",
            f"trials '{trials[i].name}' and '{trials[j].name}'",
            f"each swam the other's drive: crossed over, their misfit falls to {gain:.0%} (that of '{trials[i].name}' "
            f"from {here:.2f} to {there:.2f})",
            "each run to fit its own drive best",
            "swap the two files in dataset.toml, or their drives",
            trials=(trials[i].name, trials[j].name),
            corrected=partial(redriven, drives={trials[i].name: drives[own[j]], trials[j].name: drives[own[i]]}),
        )
    for i, trial in enumerate(trials):
        if fitted or i in taken or own[i] < 0 or not np.isfinite(table[i, own[i]]):
            continue
        best = int(np.argmin(table[i]))
        if table[i, own[i]] > _FOREIGN and table[i, best] < _SHARE * table[i, own[i]]:
            whose = ", ".join(f"'{other.name}'" for k, other in enumerate(trials) if own[k] == best)
            yield Finding(
                "labels-wrong",
                "blocks",
                f"trial '{trial.name}'",
                f"it swam the drive of {whose}: its own leaves {table[i, own[i]]:.2f} of its power unexplained, that "
                f"one {table[i, best]:.2f}",
                "each run to fit its own drive best",
                "correct its drive or its file in dataset.toml",
                trials=(trial.name,),
                corrected=partial(redriven, drives={trial.name: drives[best]}),
            )
        elif table[i, own[i]] > _FOREIGN:
            yield from _beats_otherwise(trial)


def _beats_otherwise(trial: Trial) -> Iterator[Finding]:
    """Find a run that beats at another frequency than its drive, where the drive has one and the run is long enough."""
    omegas = {segment.omega for segment in trial.drive}
    span = float(np.ptp(trial.time))
    frequency = np.arange(0.2, 0.4 / trial.step, 0.25 / span)
    wave = np.exp(-2j * np.pi * frequency[:, None] * trial.time) @ (trial.velocity[:, 2] - trial.velocity[:, 2].mean())
    found, asked = float(frequency[np.argmax(np.abs(wave))]), float(trial.drive[0].omega / (2.0 * np.pi))
    # A tail that gives way may answer loudest at three times the beat.
    harmonic = abs(found - max(round(found / asked), 1) * asked) < 2.0 / span
    if len(omegas) > 1 or harmonic or span * asked < _BEATS:
        return
    yield Finding(
        "labels-beat",
        "blocks",
        f"trial '{trial.name}'",
        f"the fish beats at {found:.2f} Hz, its drive at {asked:.2f} Hz",
        "a fish that beats as it is driven",
        "correct its drive or its file in dataset.toml",
        trials=(trial.name,),
    )


def _pairs(table: FloatArray, own: Sequence[int]) -> Iterator[tuple[float, int, int]]:
    """Yield what is left of the misfit when two runs are crossed over, and the two, where it helps both."""
    for i in range(len(own)):
        for j in range(i):
            if own[i] == own[j] or min(own[i], own[j]) < 0:
                continue
            now = np.array([table[i, own[i]], table[j, own[j]]])
            crossed = np.array([table[i, own[j]], table[j, own[i]]])
            if np.all(np.isfinite(now)) and np.all(np.isfinite(crossed)) and np.all(crossed < _SWAPPED * now):
                yield float(crossed.sum() / now.sum()), j, i


def resting(trial: Trial) -> FloatArray | None:
    """Return velocities (n, 3) of the rest before the joints first move, None where there is none of 25 samples.

    Only trials with measured joint angles can have one: a CPG starts at 0 s.
    """
    if trial.joint_angle is None:
        return None
    span = np.ptp(trial.joint_angle, axis=0).max()
    moved = np.abs(trial.joint_angle - trial.joint_angle[0]).max(axis=1) > 0.02 * span
    still = int(np.argmax(moved)) if moved.any() else len(moved)
    return trial.velocity[: still - 5] if still >= 30 else None


def start_findings(trial: Trial, guess: FloatArray | None, noise: FloatArray) -> Iterator[Finding]:
    """Find a run that was under way when it is said to start, or that reads something while it rests.

    Args:
        trial: the run.
        guess: (n, 3) its nominal simulation, from rest; None where there is none.
        noise: (3,) sigma.
    """
    rest = resting(trial)
    if rest is not None:
        mean, error = rest.mean(axis=0), 3.0 * rest.std(axis=0) / math.sqrt(len(rest)) * 3.0 + 1e-12
        least = 0.05 * np.abs(trial.velocity).max(axis=0)
        for channel in np.flatnonzero((np.abs(mean) > error) & (np.abs(mean) > least)):
            yield Finding(
                "start-offset",
                "suspect",
                f"trial '{trial.name}', {CHANNELS[channel]}",
                f"it reads {mean[channel]:.3g} {UNITS[CHANNELS[channel]]} while the joints rest",
                "0 at rest in still water",
                "subtract it if it is the sensor's; it is a current if it turns with the heading",
                trials=(trial.name,),
                channels=(CHANNELS[channel],),
            )
    if guess is None or not trial.starts_at_rest or trial.time[0] > 0.05:
        return
    few = slice(0, max(int(0.1 / trial.step), 2))
    usual = float(np.median(trial.velocity[len(trial.time) // 2 :, 0]))
    excess = float(np.median(trial.velocity[few, 0] - guess[few, 0]))
    if usual > 0.0 and excess > _MOVING * usual and excess > 6.0 * float(noise[0]):
        yield Finding(
            "start-moving",
            "blocks",
            f"trial '{trial.name}', first {few.stop} rows",
            f"the fish swims at {excess:.2f} m/s when its drive is said to start ({excess / usual:.0%} of its later "
            "speed)",
            "a start from rest at 0 s, as every run that a CPG drives has",
            "give the recording from the start of the drive, or measured joint angles",
            trials=(trial.name,),
        )


def time_units(trials: Sequence[Trial], factors: Mapping[str, float]) -> Iterator[Finding]:
    """Say which recorded joints beat at a frequency of no fish: their times are in another unit.

    Args:
        trials: as they were read.
        factors: `time_factor` by the trial's name.
    """
    strange = [trial for trial in trials if factors[trial.name] != 1.0 and not trial.drive]
    for factor in dict.fromkeys(factors[trial.name] for trial in strange):
        named = tuple(trial.name for trial in strange if factors[trial.name] == factor)
        everywhere = len(named) == len(trials)
        first = next(trial for trial in strange if trial.name == named[0])
        unit = "they are in ms" if factor < 1.0 else "they are in s and were divided by 1000"
        yield Finding(
            "sampling-unit",
            "blocks",
            f"{'all trials' if everywhere else 'trials ' + ', '.join(named)}, time",
            f"the joints of '{first.name}' beat at {min(beats(first)):.3g} Hz, with a sample every {first.step:.3g} s",
            f"a beat of {_PLAUSIBLE[0]:g} to {_PLAUSIBLE[1]:g} Hz",
            f"{unit}: multiply the times by {factor:g}; the other findings take them so",
            trials=() if everywhere else named,
        )


def sampling(trials: Sequence[Trial], enough: Sequence[bool]) -> Iterator[Finding]:
    """Say which runs are sampled too coarsely, or have times in another unit."""
    coarse = [trial for trial, fine in zip(trials, enough, strict=True) if not fine]
    if not coarse:
        return
    trial = coarse[0]
    step = trial.step
    beat = 2.0 * math.pi / max(segment.omega for segment in trial.drive)
    yield Finding(
        "sampling-coarse",
        "blocks",
        f"{'all trials' if len(coarse) == len(trials) else 'trials ' + ', '.join(t.name for t in coarse)}, time",
        f"'{trial.name}' has a sample every {step:.4g} s, {beat / step:.2g} a beat, for {trial.time[-1]:.4g} s",
        "5 samples a beat or more, and hours at most",
        "multiply the times by 0.001 if they are in ms; else record faster",
        trials=tuple(trial.name for trial in coarse),
    )
