"""Validation of a recording: its times, its joint angles, its drive, its tank."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from mjfish.data import columns
from mjfish.data.trial import Dataset, Tank, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.wave import Wave
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray

#: Joints that move less than this do not beat [rad].
_STILL = 1e-6
#: Frequencies closer than this share are the same.
SAME = 0.05
#: Beats that a periodogram tells apart from a drift; below it, sinusoids are fitted.
_RESOLVED = 3
_STEP = 0.05


def count_beats(time: FloatArray, angle: FloatArray) -> float | None:
    """Return the number of beats: the dominant frequency of the joint angles times the duration.

    With three beats or more that is the largest line of the periodogram of all joints, their linear drift removed.
    With fewer, a line of the periodogram cannot be told from a drift: there it is the frequency at which the least
    squares fit of mean, drift and one sinusoid leaves the smallest residual.

    Args:
        time: (n,) increasing, n > 6 [s].
        angle: (n, joints) [rad].

    Returns:
        The number of beats, or None where the joints are still.
    """
    share = (time - time[0]) / (time[-1] - time[0])
    rest = residual(beat_columns(share, 0.0, 0), angle)
    if np.ptp(rest, axis=0).max() < _STILL:
        return None
    strongest = int(np.argmax(np.square(np.abs(np.fft.rfft(rest, axis=0))).sum(axis=1)))
    if strongest >= _RESOLVED:
        return float(strongest)
    beats = np.arange(2 * _STEP, _RESOLVED + 1, _STEP)
    left = [np.square(residual(beat_columns(share, turns), angle)).sum() for turns in beats]
    return float(beats[int(np.argmin(left))])


def beats(trial: Trial) -> list[float]:
    """Return the beat frequencies [Hz] of a trial: of its CPG, its wave, or its measured joints."""
    if trial.drive:
        return [segment.omega / (2.0 * np.pi) for segment in trial.drive if segment.start < trial.time[-1]]
    if trial.wave is not None:
        return [trial.wave.frequency]
    if trial.joint_angle is None:
        return []
    count = count_beats(trial.time, trial.joint_angle)
    return [] if count is None else [count / float(np.ptp(trial.time))]


def beat_columns(share: FloatArray, turns: float, harmonics: int = 1) -> FloatArray:
    """Return a mean, a drift, and a beat of so many turns with its harmonics, as columns over a share (n,) of a run."""
    phases = (2.0 * np.pi * turns * k * share for k in range(1, harmonics + 1))
    waves = [wave(phase) for phase in phases for wave in (np.cos, np.sin)]
    return np.column_stack([np.ones_like(share), share, *waves])


def residual(design: FloatArray, signal: FloatArray) -> FloatArray:
    """Return what the least squares fit of the columns of a design leaves of a signal (n,) or (n, k)."""
    return np.asarray(signal - design @ np.linalg.lstsq(design, signal)[0], dtype=np.float64)


#: A step longer than this many median steps is a gap: one lost sample makes 2, jitter of the clock far less than 1.5.
GAP = 1.5
#: Fewest samples that the smoothing spline of measured joint angles takes.
_FEWEST = 7
#: Longest gap that it bridges: share of a beat, of joints without a beat [s], and steps: a lost sample it always does.
_BRIDGED, _WITHOUT, _STEPS = 0.25, 0.1, 2.5
#: The number of beats in measured angles is estimated, so a recording is not refused for a twentieth.
_BEAT_TOLERANCE = 0.05


def check_times(time: FloatArray, path: Path, *, gaps: bool = False) -> None:
    """Refuse times that do not increase, repeat, or, unless `gaps` are allowed, leave a gap.

    Args:
        time: (n,) finite [s].
        path: the file, for messages.
    """
    if len(time) < 2:
        raise InputError(f"{path}: has 1 row, expected a recording of at least one beat; record longer")
    columns.check_increasing(time, path)
    steps = np.diff(time)
    median = float(np.median(steps))
    wide = np.flatnonzero(steps > GAP * median)
    if wide.size and not gaps:
        index = int(wide[0]) + 1
        raise InputError(
            f"{columns.row_name(path, index)}: a gap of {steps[index - 1]:.6g} s from row {index} "
            f"({time[index - 1]:.9g} s) to row {index + 1} ({time[index]:.9g} s), expected steps of about {median:.6g} "
            f"s; cut the recording there into two trials, fill in the missing rows, or, where a CPG drives the fish, "
            f"say gaps = true in its entry ({wide.size} gaps in the file)"
        )


def check_angles(time: FloatArray, angle: FloatArray, path: Path) -> None:
    """Refuse joint angles that must be degrees, recordings shorter than one beat, and gaps that no spline bridges.

    Args:
        time: (n,) checked by `check_times` [s].
        angle: (n, joints) finite [rad].
        path: the file, for messages.
    """
    far = np.argwhere(np.abs(angle) > np.pi)
    if far.size:
        index, joint = int(far[0, 0]), int(far[0, 1])
        header = columns.header(columns.joint(joint + 1))
        raise InputError(
            f"{columns.row_name(path, index)}, column '{header}': {angle[index, joint]:g} rad is more than half a "
            "turn, expected radians; if these are degrees, multiply by pi/180"
        )
    if len(time) < _FEWEST:
        raise InputError(
            f"{path}: has {len(time)} rows, expected {_FEWEST} or more where joint angles are measured; record longer"
        )
    beats = count_beats(time, angle)
    if beats is not None and beats < 1.0 - _BEAT_TOLERANCE:
        raise InputError(
            f"{path}: lasts {time[-1] - time[0]:.4g} s, which is {beats:.2g} of a beat of the joint angles, expected "
            "one beat or more; record longer"
        )
    limit = longest_gap(time, angle)
    wide = np.flatnonzero(np.diff(time) > limit)
    if wide.size:
        raise InputError(
            f"{columns.row_name(path, int(wide[0]) + 1)}: no joint angles from {time[wide[0]]:.6g} to "
            f"{time[wide[0] + 1]:.6g} s, expected gaps of {limit:.3g} s at most, a quarter of a beat; cut the run "
            f"there into two trials ({wide.size} gaps are like this)"
        )


def longest_gap(time: FloatArray, angle: FloatArray) -> float:
    """Return how long a gap in recorded joint angles (n, joints) may be, so that a spline bridges it [s]."""
    beats = count_beats(time, angle)
    longest = _WITHOUT if beats is None else _BRIDGED * float(time[-1] - time[0]) / beats
    return max(longest, _STEPS * float(np.median(np.diff(time))))


def check_cpg(time: FloatArray, drive: tuple[DriveSegment, ...], fish: Fish, path: Path, key: str) -> None:
    """Refuse a drive that the CPG of the fish cannot follow, and a recording that does not fit it in time.

    Args:
        time: (n,) checked by `check_times` [s].
        drive: one segment or more.
        fish: driven.
        path: the file, for messages.
        key: of the drive in its file, for messages.
    """
    if fish.cpg is None:
        raise InputError(
            f"{key}: fish '{fish.name}' has no CPG, expected measured joint angles; remove the drive and give columns "
            f"'{columns.header(columns.joint(1))}' to '{columns.header(columns.joint(fish.joints))}', or add [cpg] to "
            "the fish"
        )
    for number, segment in enumerate(drive, start=1):
        if len(segment.bias) != fish.joints:
            raise InputError(
                f"{key}.{number}.bias: {len(segment.bias)} numbers, expected {fish.joints}, one for each joint of fish "
                f"'{fish.name}'; correct it"
            )
    if drive[0].start != 0.0:
        raise InputError(
            f"{key}.1.start: {drive[0].start:g} s, expected 0; the first segment starts the fish from rest"
        )
    for number, (before, here) in enumerate(pairwise(drive), start=2):
        if here.start <= before.start:
            raise InputError(
                f"{key}.{number}.start: {here.start:g} s is not after the {before.start:g} s of the segment before, "
                "expected increasing starts; sort the segments"
            )
    _check_span(time, 2.0 * math.pi / drive[0].omega, f"omega = {drive[0].omega:g} rad/s", path, "the CPG")
    if drive[-1].start >= time[-1]:
        raise InputError(
            f"{key}.{len(drive)}.start: {drive[-1].start:g} s is not before the end of {path} at {time[-1]:g} s; "
            "remove the segment, or correct its start"
        )


def check_wave(time: FloatArray, wave: Wave, path: Path, key: str) -> None:
    """Refuse a recording that does not fit the wave that drives it.

    Args:
        time: (n,) checked by `check_times` [s].
        wave: one of everything a joint.
        path: the file, for messages.
        key: of the drive in its file, for messages.
    """
    far = [number for number, angle in enumerate(wave.amplitude, start=1) if abs(angle) > np.pi]
    if far:
        raise InputError(
            f"{key}.amplitude: {wave.amplitude[far[0] - 1]:g} rad at joint {far[0]} is more than half a turn, expected "
            "radians; if these are degrees, multiply by pi/180"
        )
    ramp = "a wave with a ramp" if wave.ramp > 0.0 else ""
    _check_span(time, 1.0 / wave.frequency, f"frequency = {wave.frequency:g} Hz", path, ramp)


def _check_span(time: FloatArray, period: float, stated: str, path: Path, starting: str) -> None:
    """Refuse times without one beat, and times before 0 s, where something is `starting`."""
    if starting and time[0] < 0.0:
        raise InputError(
            f"{columns.row_name(path, 0)}, column 'time [s]': {time[0]:g} s, expected 0 s or later, for {starting} "
            "starts at 0 s; remove the rows before, or shift the times"
        )
    # One step more: the samples of one whole beat span a step less than the beat.
    if time[-1] - time[0] + float(np.median(np.diff(time))) < (1.0 - 1e-9) * period:
        raise InputError(
            f"{path}: lasts {time[-1] - time[0]:.4g} s, expected one beat of {period:.4g} s ({stated}) or more; "
            "record longer"
        )


def check_in_tank(pose: FloatArray, tank: Tank, source: Path) -> None:
    """Refuse a nose outside of the tank: its walls, or the poses, are then not what they seem."""
    outside = np.flatnonzero(tank.distance(pose) < 0.0)
    if len(outside):
        x, y = pose[outside[0], :2]
        raise InputError(
            f"{columns.row_name(source, int(outside[0]))}: x = {x:g} m, y = {y:g} m, expected a nose within the tank, "
            f"x from {tank.x[0]:g} to {tank.x[1]:g} m, y from {tank.y[0]:g} to {tank.y[1]:g} m; correct tank or poses"
        )


def check_comparable(dataset: Dataset, what: str) -> None:
    """Refuse a dataset whose trials were not measured alike: all three velocities in each, or places and headings.

    `what` needs that.
    """
    check_velocities(dataset, what, poses=True)
    moving = [trial.name for trial in dataset.trials if trial.measured.any()]
    if moving and len(moving) < len(dataset.trials):
        raise InputError(
            f"{dataset.name}: trials {', '.join(moving)} have velocities, the others places or headings alone, and "
            f"{what} compares all trials in the same numbers; make a dataset of each kind"
        )


def check_velocities(dataset: Dataset, what: str, *, poses: bool = False) -> None:
    """Refuse a dataset where a trial has not all three velocities, nor `poses` of sensors alone; `what` needs them."""
    for trial in dataset.trials:
        absent = [columns.header(name) for name, there in zip(CHANNELS, trial.measured, strict=True) if not there]
        seen = poses and {sensor.kind for sensor in trial.sensors} & {"position", "heading"}
        if absent and (len(absent) < len(CHANNELS) or not seen):
            raise InputError(
                f"{dataset.name}: trial '{trial.name}' has no {', '.join(absent)}, and {what} rests on surge, sway and "
                f"yaw rate in every trial{', or on sensors of kind position and heading' if poses else ''}; add what "
                f"is missing, or leave the trial out{' (mjfish identify takes it)' if poses else ''}"
            )
