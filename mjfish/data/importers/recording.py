"""From a smoothed run to trials: which stretches are kept, how often they are sampled, what noise they carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Dataset, Trial, errors
from mjfish.data.importers.report import Cut
from mjfish.data.importers.smooth import stretch, velocity
from mjfish.data.importers.smooth.batch import Fit
from mjfish.drive.wave import Wave
from mjfish.errors import InputError

#: Shortest stretch that is kept: beats, or seconds where there is no beat.
BEATS, SECONDS = 2.0, 1.0
#: Samples a beat that measured joint angles need, so that a spline through them keeps the accelerations.
_SAMPLES = 24.0


@dataclass(frozen=True, eq=False)
class Recording:
    """The trials of one run and what is known of them.

    Attributes:
        trials: without roles.
        noise: (3,) sigma of surge, sway [m/s], yaw rate [rad/s], rms over what is kept.
        joint_noise: rms sigma of the joint angles [rad]; None without joints.
        alike: how long the errors stay alike [s].
        cuts: what was not kept, and why.
        bridged: frames kept in which points were lost.
        starts: when each trial begins in the file [s].
    """

    trials: tuple[Trial, ...]
    noise: FloatArray
    joint_noise: float | None
    alike: float
    cuts: tuple[Cut, ...]
    bridged: int
    starts: tuple[float, ...]

    def driven_by(self, wave: Wave | None) -> Recording:
        """Return the recording with its trials driven by a wave, whose clock is that of the file."""
        if wave is None:
            return self
        trials = (
            replace(trial, time=readonly(trial.time + at), wave=wave)
            for trial, at in zip(self.trials, self.starts, strict=True)
        )
        return replace(self, trials=tuple(trials))


def record(
    fit: Fit,
    joints: int,
    seen: BoolArray,
    reasons: dict[int, str],
    name: str,
    source: Path,
    roll: FloatArray | None = None,
) -> Recording:
    """Turn a fit into trials.

    Args:
        fit: coordinates x, y, yaw, then joint angles.
        joints: how many joint angles there are.
        seen: (n,) frames in which enough points were seen.
        reasons: what was lost, by frame.
        name: of the run.
        source: the file.
        roll: (n,) [rad], where it was measured.

    Raises:
        InputError: no stretch is long enough.
    """
    moved = velocity.of(fit)
    angle_sigma = np.column_stack([np.zeros((len(seen), 0)), *(velocity.sigma_of(fit, 3 + i) for i in range(joints))])
    keep = stretch.known(moved.sigma, angle_sigma, seen)
    step = float(np.median(np.diff(fit.basis.time)))
    fewest = int(np.ceil((SECONDS if fit.beat is None else BEATS / fit.beat) / step))
    kept = [(a, b) for a, b in stretch.runs(keep) if b - a >= fewest]
    if not kept:
        found = stretch.longest(stretch.runs(keep))
        what = f"{BEATS:g} beats" if fit.beat is not None else f"{SECONDS:g} s"
        raise InputError(
            f"{source}: the longest usable stretch has {found} frames, expected {fewest} or more ({what})"
            f"{_lost(reasons)}; record longer, track again, or leave this file out"
        )
    every = _every(moved.apart, joints, fit.beat, step)
    place = fit.coordinates()
    names = [name] if len(kept) == 1 else [f"{name}-{letter}" for letter in _letters(len(kept))]
    trials = [
        _trial(label, fit, place, moved.value, slice(a, b, every), joints, source, roll)
        for label, (a, b) in zip(names, kept, strict=True)
    ]
    inside = np.zeros(len(seen), dtype=np.bool_)
    for a, b in kept:
        inside[a:b] = True
    return Recording(
        trials=tuple(trials),
        noise=np.sqrt(np.square(moved.sigma[inside]).mean(axis=0)),
        joint_noise=float(np.sqrt(np.square(angle_sigma[inside]).mean())) if joints else None,
        alike=moved.apart * step,
        cuts=tuple(Cut(a * step, b * step, _reason(reasons, a, b, len(seen), keep)) for a, b in stretch.runs(~inside)),
        bridged=int((inside & ~seen).sum()),
        starts=tuple(float(fit.basis.time[a]) for a, _ in kept),
    )


def with_noise(dataset: Dataset, recordings: Sequence[Recording]) -> Dataset:
    """Return the dataset with the rms of the noise over its fit trials: a held-out file must not change the fit."""
    variance = {trial.name: np.square(one.noise) for one in recordings for trial in one.trials}
    fitted, _ = dataset.split()
    weights = [len(trial.time) for trial in fitted]
    mean = np.average([variance[trial.name] for trial in fitted], axis=0, weights=weights)
    return replace(dataset, noise=readonly(np.sqrt(mean)))


def _trial(
    name: str,
    fit: Fit,
    place: FloatArray,
    value: FloatArray,
    rows: slice,
    joints: int,
    source: Path,
    roll: FloatArray | None,
) -> Trial:
    time = fit.basis.time
    pose = place[rows, :3] - [*place[rows.start, :2], 0.0]
    return Trial(
        name=name,
        role=None,
        time=readonly(time[rows] - time[rows.start]),
        velocity=readonly(value[rows]),
        joint_angle=readonly(place[rows, 3 : 3 + joints]) if joints else None,
        pose=readonly(pose),
        roll=None if roll is None else readonly(roll[rows]),
        source=source,
        errors=readonly(_errors(fit, rows, joints)) if joints else None,
    )


def _errors(fit: Fit, rows: slice, joints: int) -> FloatArray:
    """Return the modes (modes, n, 3 + joints) of the errors of velocities and joint angles."""
    values, vectors = np.linalg.eigh(fit.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    slopes = [*velocity.gradients(fit), *(fit.gradient(3 + i) for i in range(joints))]
    return errors.principal(np.stack([slope[rows] @ root for slope in slopes]))


def _every(apart: int, joints: int, beat: float | None, step: float) -> int:
    """Return how many frames a sample takes: errors independent, but joint angles dense enough for a spline."""
    if not joints:
        return max(apart, 1)
    dense = 1.0 / (_SAMPLES * beat * step) if beat is not None else 1.0
    return max(min(apart, int(dense)), 1)


def _reason(reasons: dict[int, str], start: int, end: int, frames: int, keep: BoolArray) -> str:
    lost = {reasons[frame] for frame in range(start, end) if frame in reasons}
    if lost and not keep[start:end].all():
        return f"{', '.join(sorted(lost))} lost"
    if keep[start:end].all():
        return f"shorter than {BEATS:g} beats"
    return "end of the record, motion half as well known" if start == 0 or end == frames else "motion not known"


def _lost(reasons: dict[int, str]) -> str:
    counts: dict[str, int] = {}
    for reason in reasons.values():
        counts[reason] = counts.get(reason, 0) + 1
    return "".join(f"; {reason} lost in {count} frames" for reason, count in sorted(counts.items()))


def _letters(count: int) -> list[str]:
    """Return suffixes a, b, ... for several trials of a file; numbers where letters run out."""
    return list(ascii_lowercase[:count]) if count <= len(ascii_lowercase) else [str(i + 1) for i in range(count)]
