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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mjfish.data import Dataset, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import Finding, changed
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

#: Clock shifts that are tried [s]: a late servo or clock must not look like a wrong sign, nor half a beat like none.
_CLOCK_SHIFTS = 0.01 * np.arange(-6.0, 7.0)
#: By how much (of 3) a hypothesis must correlate better than the channels as they are, and how well at least.
_MARGIN, _GOOD = 0.6, 2.4
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
#: A channel this many times larger or smaller than simulated is in another unit: that which is within this factor.
_STRANGE, _NEAR_UNIT = 12.0, 3.0
#: Smallest amplitude a.
_LOW = 0.5
#: Two runs are swapped where, crossed over, both cost less than this share of what they cost as they are.
_SWAPPED = 0.5
#: One run has the wrong label where its own drive costs this much, and another's this share of it.
_FOREIGN, _SHARE = 0.4, 0.25
#: Fewest beats from which a frequency is read.
_BEATS = 5.0
#: A run is under way at its start where its first samples have this share of the later speed.
_MOVING = 0.5


def against_simulation(fish: Fish, trials: Sequence[Trial], noise: FloatArray) -> Iterator[Finding]:
    """Hold trials against the nominal simulation: starts, units, signs; where these are right, labels.

    Args:
        fish: that swam.
        trials: of which motions can be recognised.
        noise: (3,) sigma.
    """
    model, declared, starts = Model(fish), dict(fish.values), {p.name: p.start for p in fish.parameters}
    sets = [declared] if declared == starts else [declared, starts]
    sizes, correlations = dict[str, FloatArray](), dict[str, FloatArray]()
    for trial in trials:
        blank, start = replace(trial, pose=None), trial.first_velocity
        every = (shifted(model, blank, values, _CLOCK_SHIFTS, velocity=start) for values in sets)
        guesses = [guess for guess in every if guess is not None]
        if not guesses:
            continue
        unshifted = [guess[len(_CLOCK_SHIFTS) // 2] for guess in guesses]
        nearest = min(unshifted, key=lambda guess: float(np.sum((trial.velocity[:, 0] - guess[:, 0]) ** 2)))
        own = list(start_findings(trial, nearest, noise))
        yield from own
        if not any(finding.severity == "blocks" for finding in own):
            sizes[trial.name], correlations[trial.name] = _size(trial, unshifted), _scores(trial, guesses)
    turned = [*units(sizes), *signs(correlations)]
    yield from turned
    if not turned:  # a run that is read wrongly has no label to speak of
        yield from labels(model, [trial for trial in trials if trial.drive and trial.name in sizes], sets)


def shifted(
    model: Model,
    trial: Trial,
    values: Mapping[str, float],
    by: FloatArray,
    *,
    velocity: FloatArray | None = None,
    offset: float = 0.0,
) -> FloatArray | None:
    """Predict the velocities (s, n, 3) of a trial at its times shifted by some seconds (s,); None after a divergence.

    Args:
        model, trial, values, velocity, offset: as of `mjfish.Model.predict`.
        by: shifts.
    """
    rollout = model.predict(trial, values, velocity=velocity, offset=offset).rollout
    if rollout.status != "ok":
        return None
    when = model.prepare(trial, values, velocity=velocity, offset=offset).time + by[:, None]
    inside = np.clip(when, rollout.time[0], rollout.time[-1])
    return np.asarray(rollout.at(inside.ravel())[:, :3].reshape(*when.shape, 3))


#: How the channels of a trial may have to be read: the column that each is in, and its sign; the first as they are.
READINGS = [*itertools.product(((0, 1, 2), (1, 0, 2)), itertools.product((1, -1), repeat=3))]
_ORDERS, _SIGNS = (np.array(each) for each in zip(*READINGS, strict=True))


def _scores(trial: Trial, guessed: Sequence[FloatArray]) -> FloatArray:
    """Return, for every reading, the sum of the three correlations with the best guess and clock; at most 3."""
    own = np.sqrt(np.sum(trial.velocity**2, axis=0)) + 1e-12
    found = []
    for guess in guessed:
        theirs = np.sqrt(np.sum(guess**2, axis=1)) + 1e-12
        correlation = np.einsum("ta,stb->sab", trial.velocity, guess) / own[:, None] / theirs[:, None, :]
        found.append((correlation[:, _ORDERS, np.arange(3)] * _SIGNS).sum(axis=2).max(axis=0))
    return np.asarray(np.max(found, axis=0))


def signs(found: Mapping[str, FloatArray]) -> Iterator[Finding]:
    """Say which channels are read the wrong way, in all trials alike or in some.

    Args:
        found: `_scores` by the trial's name.
    """
    wrong = {
        name: int(np.argmax(score)) for name, score in found.items() if score.max() > max(score[0] + _MARGIN, _GOOD)
    }
    for reading in dict.fromkeys(wrong.values()):
        names = [name for name, own in wrong.items() if own == reading]
        everywhere = len(names) == len(found)
        place = (
            "all trials" if everywhere else f"trials {', '.join(names)}" if len(names) > 1 else f"trial '{names[0]}'"
        )
        own, better = (float(np.mean([found[name][k] for name in names])) / 3.0 for k in (0, reading))
        channels, words, remedy = _misread(*READINGS[reading])
        yield Finding(
            "signs-channel",
            "blocks",
            f"{place}, {' and '.join(channels)}",
            f"{words}: so read, the mean correlation with the nominal simulation is {better:.2f}, as it stands "
            f"{own:.2f}",
            "surge forward, sway to port, yaw rate anticlockwise seen from above",
            remedy,
            trials=() if everywhere else tuple(names),
            channels=channels,
            corrected=_rereading(names, *READINGS[reading]),
        )


def _misread(order: tuple[int, ...], factors: tuple[int, ...]) -> tuple[tuple[str, ...], str, str]:
    """Return the channels that are read the wrong way, what is wrong with them, and the remedy."""
    swapped = order[0] != 0
    flipped = [name for name, sign in zip(CHANNELS, factors, strict=True) if sign < 0]
    flip = " and ".join(flipped)
    wrong = {"swap surge and sway": "surge and sway are in each other's column"} if swapped else {}
    if flipped:
        wrong[f"multiply {flip} by -1"] = f"{flip} {'has' if len(flipped) == 1 else 'have'} the wrong sign"
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], str] = {
        ((0, 1, 2), (1, -1, -1)): "multiply both by -1 (y to starboard, z down), or the joint angles and biases if "
        "those are mirrored",
        ((0, 1, 2), (-1, -1, 1)): "multiply both by -1: x points to the tail",
    }
    channels = tuple(name for name in CHANNELS if name in flipped or (swapped and name != "yaw_rate"))
    return channels, ", and ".join(wrong.values()), known.get((order, factors), " and ".join(wrong))


def _rereading(names: Iterable[str], order: Sequence[int], factors: Sequence[float]) -> Callable[[Dataset], Dataset]:
    """Return what reads the velocities of some trials from other columns, then multiplies them."""
    return partial(changed, changes=dict.fromkeys(names, partial(_reread, order=order, factors=factors)))


def _reread(trial: Trial, order: Sequence[int], factors: Sequence[float]) -> Trial:
    return replace(trial, velocity=readonly(trial.velocity[:, [*order]] * factors))


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
        if strange:
            size = float(np.median(list(strange.values())))
            factor = min(known, key=lambda f: abs(np.log(size / f)))
            near = abs(np.log(size / factor)) < np.log(_NEAR_UNIT)
            everywhere = len(strange) == len(sizes)
            yield Finding(
                "signs-unit",
                "blocks" if near else "suspect",  # far from any unit: a fish that hardly follows its drive is so, too
                f"{'all trials' if everywhere else 'trial ' + ', '.join(strange)}, {name}",
                f"it is {size:.3g} times as large as simulated",
                f"a size within a factor of {_STRANGE:g}",
                known[factor] if near else "check the unit and the drive",
                trials=() if everywhere else tuple(strange),
                channels=(name,),
                corrected=_rereading(strange, range(3), [1.0 / factor if own == name else 1.0 for own in CHANNELS]),
            )


def _size(trial: Trial, guessed: Sequence[FloatArray]) -> FloatArray:
    """Return rms measured over rms simulated (3,), with that of the guesses (n, 3) that is nearest."""
    squares = np.array([np.mean(guess**2, axis=0) for guess in guessed])
    every = np.sqrt(np.mean(trial.velocity**2, axis=0) / (squares + 1e-24))
    return np.asarray(every[np.argmin(np.abs(np.log(every + 1e-12)), axis=0), np.arange(3)])


def labels(
    model: Model, trials: Sequence[Trial], sets: Sequence[Mapping[str, float]], sigma: FloatArray | None = None
) -> Iterator[Finding]:
    """Find pairs of runs that changed places, and before a fit runs that swam another run's drive, or none.

    Args:
        model: that predicts.
        trials: driven by a CPG.
        sets: values of its parameters that are tried; those count whose predictions fit the trials' own drives best.
        sigma: (3,) after a fit: then a = 1, and costs are mean squares of the misfit over sigma.
    """
    drives = list(dict.fromkeys(trial.drive for trial in trials))
    own = np.array([drives.index(trial.drive) for trial in trials], dtype=np.intp)
    tables = (_costs(model, trials, drives, values, sigma) for values in sets)
    table = min(tables, key=lambda costs: float(np.sum(costs[np.arange(len(own)), own])))
    taken: set[int] = set()
    for gain, i, j in sorted(_crossed(table, own)):
        if taken.isdisjoint((i, j)):
            taken |= {i, j}
            here, there = np.sqrt(table[i, own[[i, j]]])
            first, second = trials[i], trials[j]
            changes = {a.name: partial(replace, drive=b.drive) for a, b in ((first, second), (second, first))}
            yield Finding(
                "labels-swapped",
                "blocks",
                f"trials '{first.name}' and '{second.name}'",
                f"each swam the other's drive: crossed over, their misfit falls to {gain:.0%} (that of '{first.name}' "
                f"from {here:.2f} to {there:.2f})",
                "each run to fit its own drive best",
                "swap the two files in dataset.toml, or their drives",
                trials=(first.name, second.name),
                corrected=partial(changed, changes=changes),
            )
    for i, trial in enumerate(trials if sigma is None else ()):
        cost, best = table[i, own[i]], int(np.argmin(table[i]))
        if i in taken or not _FOREIGN < cost < np.inf:
            continue
        if table[i, best] < _SHARE * cost:
            whose = ", ".join(f"'{other.name}'" for other in trials if other.drive == drives[best])
            yield Finding(
                "labels-wrong",
                "blocks",
                f"trial '{trial.name}'",
                f"it swam the drive of {whose}: its own leaves {cost:.2f} of its power unexplained, that one "
                f"{table[i, best]:.2f}",
                "each run to fit its own drive best",
                "correct its drive or its file in dataset.toml",
                trials=(trial.name,),
                corrected=partial(changed, changes={trial.name: partial(replace, drive=drives[best])}),
            )
        else:
            yield from _beats_otherwise(trial)


def _costs(
    model: Model,
    trials: Sequence[Trial],
    drives: Sequence[tuple[DriveSegment, ...]],
    values: Mapping[str, float],
    sigma: FloatArray | None,
) -> FloatArray:
    """Return the costs (trials, drives) of `labels`; infinite where a rollout diverges."""
    table = np.full((len(trials), len(drives)), np.inf)
    for j, drive in enumerate(drives):
        longest = max(trials, key=lambda trial: float(trial.time[-1]))
        blank = replace(longest, drive=drive, pose=None, time=readonly(longest.time[[0, -1]]))
        run = model.predict(blank, values)
        if run.status == "ok":
            for i, trial in enumerate(trials):
                clock = np.clip(model.prepare(trial, values).time, 0.0, run.rollout.time[-1])
                table[i, j] = _cost(trial.velocity, run.rollout.at(clock)[:, :3], sigma)
    return table


def _cost(measured: FloatArray, predicted: FloatArray, sigma: FloatArray | None) -> float:
    if sigma is not None:
        return float(np.mean(((measured - predicted) / sigma) ** 2))
    amplitude = np.sum(measured * predicted, axis=0) / (np.sum(predicted**2, axis=0) + 1e-24)
    left = measured - np.clip(amplitude, _LOW, 1.0 / _LOW) * predicted
    return float(np.mean(np.sum(left**2, axis=0) / (np.sum(measured**2, axis=0) + 1e-24)))


def _crossed(table: FloatArray, own: NDArray[np.intp]) -> Iterator[tuple[float, int, int]]:
    """Yield what is left of the misfit when two runs are crossed over, and the two, where it helps both."""
    for pair in itertools.combinations(range(len(own)), 2):
        now, crossed = table[[*pair], own[[*pair]]], table[[*pair], own[[*pair[::-1]]]]
        if np.all(np.isfinite(now)) and np.all(crossed < _SWAPPED * now):
            yield (float(crossed.sum() / now.sum()), *pair)


def _beats_otherwise(trial: Trial) -> Iterator[Finding]:
    """Find a run that beats at another frequency than its drive, where the drive has one and the run is long enough."""
    span, yaw_rate = float(np.ptp(trial.time)), trial.velocity[:, 2] - trial.velocity[:, 2].mean()
    frequency = np.arange(0.2, 0.4 / trial.step, 0.25 / span)
    wave = np.exp(-2j * np.pi * frequency[:, None] * trial.time) @ yaw_rate
    found, asked = float(frequency[np.argmax(np.abs(wave))]), float(trial.drive[0].omega / (2.0 * np.pi))
    # A tail that gives way may answer loudest at three times the beat.
    harmonic = abs(found - max(round(found / asked), 1) * asked) < 2.0 / span
    if len({segment.omega for segment in trial.drive}) == 1 and not harmonic and span * asked >= _BEATS:
        yield Finding(
            "labels-beat",
            "blocks",
            f"trial '{trial.name}'",
            f"the fish beats at {found:.2f} Hz, its drive at {asked:.2f} Hz",
            "a fish that beats as it is driven",
            "correct its drive or its file in dataset.toml",
            trials=(trial.name,),
        )


def resting(trial: Trial) -> FloatArray | None:
    """Return velocities (n, 3) of the rest before the joints first move, None where there is none of 25 samples.

    Only trials with measured joint angles can have one: a CPG starts at 0 s.
    """
    if trial.joint_angle is None:
        return None
    angle = trial.joint_angle - trial.joint_angle[0]
    moved = np.abs(angle).max(axis=1) > 0.02 * np.ptp(angle, axis=0).max()
    still = int(np.argmax(moved)) if moved.any() else len(moved)
    return trial.velocity[: still - 5] if still >= 30 else None


def start_findings(trial: Trial, guess: FloatArray, noise: FloatArray) -> Iterator[Finding]:
    """Find a run that was under way when it is said to start, or that reads something while it rests.

    Args:
        trial: the run.
        guess: (n, 3) its nominal simulation, from rest.
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
    few = slice(0, max(int(0.1 / trial.step), 2))
    usual = float(np.median(trial.velocity[len(trial.time) // 2 :, 0]))
    excess = float(np.median(trial.velocity[few, 0] - guess[few, 0]))
    moving = 0.0 < _MOVING * usual < excess and excess > 6.0 * float(noise[0])
    if moving and trial.starts_at_rest and trial.time[0] <= 0.05:
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
