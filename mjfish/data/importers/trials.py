"""From a smoothed run to trials and a report: velocities of the nose, what is kept, sampling, noise and roles.

    surge = cos(yaw) x' + sin(yaw) y',   sway = cos(yaw) y' - sin(yaw) x',   yaw rate = yaw'

Kept are the frames at which the motion is known nearly as well as in the middle of the run. In a gap the smooth part of
a motion is soon unknown and its periodic part is not: this rule bridges gaps of periodic motion, with the uncertainty
that the fit states, and cuts all others. It trims the ends too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase

import numpy as np

from mjfish.data import Dataset, Role, Trial
from mjfish.data.importers.smoothing import Fit
from mjfish.data.trial import principal_modes
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly


@dataclass(frozen=True)
class Cut:
    """A stretch that was not kept.

    Attributes:
        start: [s] in the file.
        end: [s] in the file.
        reason: why.
    """

    start: float
    end: float
    reason: str

    def __str__(self) -> str:
        return f"{self.start:.2f}-{self.end:.2f} s: {self.reason}"


@dataclass(frozen=True)
class FileReport:
    """One imported file.

    Attributes:
        path: the file.
        trials: names of the trials made of it.
        frames: rows of the file.
        usable: frames in which everything was found.
        kept: samples in the trials.
        beat: frequency of the beat [Hz]; None where there is none or nobody looked.
        speed: mean surge [m/s]; None where no velocity is made of the file.
        noise: sigma of surge, sway [m/s] and yaw rate [rad/s], estimated from this file; None: not known.
        correlation_time: of the errors of the velocities [s]; samples closer than that add hardly any information; 0:
            not known.
        joint_noise: sigma of the joint angles, mean over the joints [rad]; None: not estimated.
        cuts: stretches that were not kept.
        notes: what else was done, sentences.
    """

    path: Path
    trials: tuple[str, ...]
    frames: int
    usable: int
    kept: int
    beat: float | None
    speed: float | None = None
    noise: tuple[float, float, float] | None = None
    correlation_time: float = 0.0
    joint_noise: float | None = None
    cuts: tuple[Cut, ...] = ()
    notes: tuple[str, ...] = ()


#: Headers of `rows`.
HEADERS = (
    "file", "trials", "frames", "usable", "kept", "beat [Hz]", "mean speed [m/s]",
    "sigma surge [m/s]", "sigma sway [m/s]", "sigma yaw_rate [rad/s]", "errors correlated over [s]",
    "sigma joints [rad]", "remarks",
)  # fmt: skip


@dataclass(frozen=True)
class ImportReport:
    """All files of one import.

    Attributes:
        importer: its name.
        files: in the order given.
    """

    importer: str
    files: tuple[FileReport, ...]

    def rows(self) -> list[tuple[str, ...]]:
        """Return one row of text a file, under `HEADERS`, for a table."""
        return [
            (
                file.path.name,
                ", ".join(file.trials),
                str(file.frames),
                str(file.usable),
                str(file.kept),
                "-" if file.beat is None else f"{file.beat:.3f}",
                "-" if file.speed is None else f"{file.speed:.3f}",
                *(
                    f"{sigma:.2g}" if sigma else "-"
                    for sigma in (*(file.noise or (None,) * 3), file.correlation_time, file.joint_noise)
                ),
                "; ".join([*map(str, file.cuts), *file.notes]),
            )
            for file in self.files
        ]


#: Correlation below which errors count as independent.
_INDEPENDENT = 0.3
_X, _Y, _YAW = 0, 1, 2


def nose_velocities(fit: Fit) -> tuple[FloatArray, FloatArray, int]:
    """Return the velocities of a fit whose first coordinates are x, y [m] and yaw [rad].

    Returns:
        Surge, sway [m/s], yaw rate [rad/s] of the nose (n, 3), sigma (n, 3) of their errors, and how many frames apart
        the errors of all channels are nearly independent.
    """
    yaw, rate, slopes = fit.coordinates()[:, _YAW], fit.coordinates(1), velocity_gradients(fit)
    spreads = [slope @ fit.covariance for slope in slopes]
    correlation = np.column_stack(list(map(_correlation, slopes, spreads)))
    far = np.flatnonzero((correlation < _INDEPENDENT).all(axis=1))
    velocity = np.column_stack([frames.to_body(rate[:, :2], yaw), rate[:, _YAW]])
    sigma = np.column_stack(list(map(_sigma, slopes, spreads)))
    return velocity, sigma, int(far[0]) if far.size else len(correlation)


def velocity_gradients(fit: Fit) -> list[FloatArray]:
    """Return the derivatives (n, unknowns) of surge, sway and yaw rate by all unknowns of a fit."""
    yaw, rate = fit.coordinates()[:, _YAW], fit.coordinates(1)
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    body = frames.to_body(rate[:, :2], yaw)
    along, to_port = fit.gradient(_X, 1), fit.gradient(_Y, 1)
    turned = fit.gradient(_YAW)
    return [
        cos * along + sin * to_port + body[:, 1:] * turned,
        cos * to_port - sin * along - body[:, :1] * turned,
        fit.gradient(_YAW, 1),
    ]


def _sigma(slope: FloatArray, spread: FloatArray) -> FloatArray:
    """Return sigma (n,) of errors with derivatives `slope` (n, unknowns); `spread` is that times the covariance."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("nu,nu->n", spread, slope), 0.0)))


def _correlation(slope: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the correlation (lags,) of such errors of frames so many apart, mean over the middle; lag 0 first."""
    inner = slice(len(slope) // 8, len(slope) - len(slope) // 8)
    spread, own = spread[inner], slope[inner]
    lags = range(min(max(len(slope) // 4, 1), len(own) - 1))
    products = [float(np.einsum("nu,nu->", spread[lag:], own[: len(own) - lag])) / (len(own) - lag) for lag in lags]
    return np.asarray(products) / max(products[0], 1e-300)


#: Sigma may be so many times its median.
_KNOWN = 2.0
#: Joint angles known better than this are good enough, whatever the median [rad].
_ANGLE = 0.02


def well_known(velocity: FloatArray, angle: FloatArray, seen: BoolArray) -> BoolArray:
    """Return the frames (n,) to keep.

    Args:
        velocity: (n, 3) sigma of the velocities.
        angle: (n, joints) sigma of the joint angles [rad].
        seen: (n,) frames in which the points were seen; the medians are theirs.
    """
    seen = seen if seen.any() else np.ones_like(seen)
    keep = (velocity <= _KNOWN * np.median(velocity[seen], axis=0)).all(axis=1)
    known = (angle <= np.maximum(_KNOWN * np.median(angle[seen], axis=0), _ANGLE)).all(axis=1)
    return np.asarray(keep & known)


def runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the stretches [start, end) in which `flags` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


#: Shortest stretch that is kept: beats, or seconds where there is no beat.
BEATS, SECONDS = 2.0, 1.0
#: Samples a beat that measured joint angles need, so that a spline through them keeps the accelerations.
_SAMPLES = 24.0


@dataclass(frozen=True, eq=False)
class Run:
    """What a file, or a piece of one, became.

    Attributes:
        name: of the run of the file.
        trials: without roles.
        report: what was done.
        complete: whether nothing that should be in the file had to be left out.
    """

    name: str
    trials: tuple[Trial, ...]
    report: FileReport
    complete: bool = True


def record(
    fit: Fit,
    joints: int,
    seen: BoolArray,
    reasons: dict[int, str],
    name: str,
    source: Path,
    roll: FloatArray | None = None,
) -> tuple[tuple[Trial, ...], FileReport]:
    """Turn a fit into trials, and report on them; all frames that were seen count as usable.

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
    velocity, sigma, apart = nose_velocities(fit)
    angles = [fit.gradient(3 + i) for i in range(joints)]
    angle_sigma = np.column_stack([_sigma(slope, slope @ fit.covariance) for slope in angles])
    keep = well_known(sigma, angle_sigma, seen)
    step = float(np.median(np.diff(fit.basis.time)))
    fewest = int(np.ceil((SECONDS if fit.beat is None else BEATS / fit.beat) / step))
    kept = [(a, b) for a, b in runs(keep) if b - a >= fewest]
    if not kept:
        found = max((b - a for a, b in runs(keep)), default=0)
        lost = (f"; {reason} lost in {count} frames" for reason, count in sorted(Counter(reasons.values()).items()))
        what = f"{BEATS:g} beats" if fit.beat is not None else f"{SECONDS:g} s"
        raise InputError(
            f"{source}: the longest usable stretch has {found} frames, expected {fewest} or more ({what})"
            f"{''.join(lost)}; record longer, track again, or leave this file out"
        )
    # Errors of samples are independent, but joint angles dense enough for a spline.
    every = 1 if fit.beat is None else max(min(apart, int(1.0 / (_SAMPLES * fit.beat * step))), 1)
    place = fit.coordinates()
    trials = tuple(
        _trial(label, fit, place, velocity, slice(a, b, every), joints, source, roll)
        for label, (a, b) in zip(stretch_names(name, len(kept)), kept, strict=True)
    )
    inside = np.isin(np.arange(len(seen)), np.concatenate([np.arange(a, b) for a, b in kept]))
    surge, sway, yaw_rate = np.sqrt(np.square(sigma[inside]).mean(axis=0)).tolist()
    bridged = int((inside & ~seen).sum())
    return trials, FileReport(
        path=source,
        trials=tuple(trial.name for trial in trials),
        frames=len(seen),
        usable=int(seen.sum()),
        kept=sum(len(trial.time) for trial in trials),
        beat=fit.beat,
        speed=float(np.concatenate([trial.velocity[:, 0] for trial in trials]).mean()),
        noise=(surge, sway, yaw_rate),
        correlation_time=apart * step,
        joint_noise=float(np.sqrt(np.square(angle_sigma[inside]).mean())),
        cuts=tuple(Cut(a * step, b * step, _reason(reasons, a, b, len(seen), keep)) for a, b in runs(~inside)),
        notes=(f"{bridged} frames with lost markers bridged",) if bridged else (),
    )


def with_noise(dataset: Dataset, runs: Sequence[Run]) -> Dataset:
    """Return the dataset with the rms of the noise over its fit trials: a held-out file must not change the fit."""
    variance = {trial.name: np.square(np.array(run.report.noise)) for run in runs for trial in run.trials}
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
    return Trial(
        name=name,
        role=None,
        time=readonly(time[rows] - time[rows.start]),
        velocity=readonly(value[rows]),
        joint_angle=readonly(place[rows, 3 : 3 + joints]),
        pose=readonly(place[rows, :3] - [*place[rows.start, :2], 0.0]),
        roll=None if roll is None else readonly(roll[rows]),
        source=source,
        errors=readonly(_error_modes(fit, rows, joints)),
    )


def _error_modes(fit: Fit, rows: slice, joints: int) -> FloatArray:
    """Return the modes (modes, n, 3 + joints) of the errors of velocities and joint angles."""
    values, vectors = np.linalg.eigh(fit.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    slopes = [*velocity_gradients(fit), *(fit.gradient(3 + i) for i in range(joints))]
    return principal_modes(np.stack([slope[rows] @ root for slope in slopes]))


def _reason(reasons: dict[int, str], start: int, end: int, frames: int, keep: BoolArray) -> str:
    if keep[start:end].all():
        return f"shorter than {BEATS:g} beats"
    if lost := {reasons[frame] for frame in range(start, end) if frame in reasons}:
        return f"{', '.join(sorted(lost))} lost"
    return "end of the record, motion half as well known" if start == 0 or end == frames else "motion not known"


def stretch_names(name: str, count: int) -> list[str]:
    """Return names of the trials of one run: its own, or with suffixes a, b, ...; numbers where letters run out."""
    suffixes = ascii_lowercase[:count] if count <= len(ascii_lowercase) else map(str, range(1, count + 1))
    return [name] if count == 1 else [f"{name}-{suffix}" for suffix in suffixes]


def assembled(
    runs: Sequence[Run], fish: Fish, held_out: Sequence[str], importer: str, kind: str
) -> tuple[Dataset, ImportReport]:
    """Return the dataset of runs, its trials with roles, and the report on them.

    Args:
        runs: of files; pieces of one file share its name.
        fish: that swam.
        held_out: names of trials or runs not to be fitted; where nothing is named, runs that are not complete are held
            out if there are others.
        importer: its name, for the report.
        kind: of the recordings, for the name of the dataset.

    Raises:
        UnknownNameError: `held_out` names nothing.
        InputError: two files have runs of one name, or nothing is left to fit.
    """
    places: dict[str, Path] = {}
    for run in runs:
        if places.setdefault(run.name, run.report.path) != run.report.path:
            raise InputError(
                f"{run.report.path}: its trial '{run.name}' has the name of another file's; rename one file"
            )
    trials = [(run, trial) for run in runs for trial in run.trials]
    known = {name for run, trial in trials for name in (run.name, trial.name)}
    for name in held_out:
        if name not in known:
            raise UnknownNameError("trial to hold out", name, known)
    out = [not run.complete for run, _ in trials]
    if held_out:
        out = [run.name in held_out or trial.name in held_out for run, trial in trials]
        if all(out):
            raise InputError("all trials are held out, expected one or more to fit; name fewer of them to hold out")
    roles: list[Role | None] = [None if not any(out) or all(out) else "held_out" if apart else "fit" for apart in out]
    with_roles = tuple(replace(trial, role=role) for (_, trial), role in zip(trials, roles, strict=True))
    dataset = Dataset(name=f"{kind} {', '.join(places)}", fish=fish, trials=with_roles)
    return dataset, ImportReport(importer, tuple(run.report for run in runs))
