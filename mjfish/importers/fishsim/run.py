"""From marker files to a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase

import numpy as np

from mjfish import fish as fishes
from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish
from mjfish.importers.fishsim import head, markers, motion, stretch, tail, tracking
from mjfish.importers.fishsim.markers import HEAD, RATE, TAIL, MarkerFile
from mjfish.importers.fishsim.motion import Smoother
from mjfish.importers.fishsim.stretch import Stretches
from mjfish.importers.report import Cut, FileReport, ImportReport
from mjfish.trial import Dataset, Role, Trial

#: The shipped fish that swam.
FISH = "eth_tendon"


@dataclass(frozen=True, eq=False)
class _Imported:
    """One file: its trials without roles, its report, and whether a marker had to be left out."""

    name: str
    trials: tuple[Trial, ...]
    report: FileReport
    complete: bool


@dataclass(frozen=True, eq=False)
class _Part:
    """One stretch: its trial, noise and tail."""

    trial: Trial
    noise: FloatArray
    tail: tail.TailTrack


def import_files(files: Sequence[Path], held_out: Sequence[str] = ()) -> tuple[Dataset, ImportReport]:
    """Turn marker files into a dataset of `eth_tendon` with measured joint angles.

    Velocities are those of the nose in the forward frame, differentiated from the pose; the world of the pose is the
    camera's (x to the right of the image, y up the image), its origin at the nose at the start of each trial. The
    noise of the dataset is the rms over its trials.

    Args:
        files: marker files, as they are in the folder Data/Markers of the repository.
        held_out: names of trials or runs that are not to be fitted. If empty, runs with a marker left out are held
            out where others are complete; if there are none of the one or the other, no trial gets a role.

    Raises:
        InputError: a file is not a marker file, or has no stretch of two beats with all that is needed.
        UnknownNameError: `held_out` names nothing.
    """
    fish = fishes.load(FISH)
    imported = [_import(path, fish) for path in files]
    names = [run.name for run in imported]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise InputError(f"{files[index]}: its trial '{name}' has the name of another file's; rename one file")
    trials = _with_roles(imported, held_out)
    weights = [len(trial.time) for run in imported for trial in run.trials]
    variances = [np.square(run.report.noise) for run in imported for _ in run.trials]
    dataset = Dataset(
        name=f"fishsim {', '.join(names)}",
        fish=fish,
        trials=trials,
        noise=readonly(np.sqrt(np.average(variances, axis=0, weights=weights))),
    )
    return dataset, ImportReport("fishsim", tuple(run.report for run in imported))


def _import(path: Path, fish: Fish) -> _Imported:
    file = markers.read(path)
    found = tracking.lost(file.position)
    position, gone = tracking.fill(file.position, found)
    beat = _beat(file, position, gone)
    whole = int((~found[:, list(TAIL)].any(axis=1)).sum())
    kept = stretch.choose(file, gone, RATE / beat, whole)
    smoother = Smoother.for_beat(beat)
    names = [file.name if len(kept.kept) == 1 else f"{file.name}-{letter}" for letter in _letters(len(kept.kept))]
    parts = [
        _part(name, position[a:b], fish, smoother, kept.left_out, path)
        for name, (a, b) in zip(names, kept.kept, strict=True)
    ]
    sigma = np.sqrt(np.mean([np.square(part.noise) for part in parts], axis=0))
    report = FileReport(
        path=path,
        trials=tuple(names),
        frames=len(position),
        usable=whole,
        kept=sum(len(part.trial.time) for part in parts),
        beat=beat,
        speed=float(np.concatenate([part.trial.velocity[:, 0] for part in parts]).mean()),
        noise=(float(sigma[0]), float(sigma[1]), float(sigma[2])),
        joint_noise=float(np.mean([part.tail.sigma for part in parts])),
        cuts=_cuts(gone, kept),
        notes=_notes(found, gone, kept, smoother, parts),
    )
    return _Imported(file.name, tuple(part.trial for part in parts), report, kept.left_out is None)


def _beat(file: MarkerFile, position: FloatArray, gone: BoolArray) -> float:
    """Return the beat [Hz] of the fin across the head, over the frames in which both are seen."""
    needed = [HEAD[0], HEAD[1], TAIL[-1]]
    seen = np.flatnonzero(~gone[:, needed].any(axis=1))
    if len(seen) < RATE:
        raise InputError(
            f"{file.path}: markers {', '.join(map(str, needed))} are seen together in {len(seen)} of {len(gone)} "
            f"frames, expected {RATE:.0f} or more to find the beat; track these markers again, or leave this file out"
        )
    ahead = position[seen, HEAD[0]] - position[seen, HEAD[1]]
    fin = position[seen, TAIL[-1]] - position[seen, HEAD[1]]
    lateral = (ahead[:, 0] * fin[:, 1] - ahead[:, 1] * fin[:, 0]) / np.hypot(*ahead.T)
    return motion.beat_frequency(seen / RATE, lateral)


def _part(name: str, position: FloatArray, fish: Fish, smoother: Smoother, left_out: int | None, source: Path) -> _Part:
    """Turn one stretch into a trial; frames at its ends that no full window of the smoother covers are dropped."""
    tracked = head.track(position[:, list(HEAD)])
    pose = smoother.smooth(tracked.pose)
    bent = tail.track(fish, position, pose, left_out)
    inner = slice(smoother.edge, len(position) - smoother.edge)
    pose = pose[inner] - [*pose[smoother.edge, :2], 0.0]
    trial = Trial(
        name=name,
        role=None,
        time=readonly(np.arange(len(pose)) / RATE),
        velocity=readonly(motion.velocities(tracked.pose, smoother)[inner]),
        joint_angle=readonly(bent.joint_angle[inner]),
        pose=readonly(pose),
        source=source,
    )
    return _Part(trial, motion.noise(tracked, smoother), bent)


def _letters(count: int) -> list[str]:
    """Return suffixes a, b, ... for several trials of a file; numbers where letters run out."""
    return list(ascii_lowercase[:count]) if count <= len(ascii_lowercase) else [str(i + 1) for i in range(count)]


def _cuts(gone: BoolArray, kept: Stretches) -> tuple[Cut, ...]:
    inside = np.zeros(len(gone), dtype=bool)
    for a, b in kept.kept:
        inside[a:b] = True
    return tuple(Cut(a / RATE, b / RATE, stretch.reasons(gone, kept, a, b)) for a, b in tracking.runs(~inside))


def _notes(
    found: BoolArray, gone: BoolArray, kept: Stretches, smoother: Smoother, parts: Sequence[_Part]
) -> tuple[str, ...]:
    notes = []
    if kept.left_out is not None:
        count = int(found[:, kept.left_out].sum())
        notes.append(f"marker {kept.left_out} lost in {count} frames and not used")
    filled = int((found & ~gone).any(axis=1).sum())
    if filled:
        notes.append(f"short losses filled in {filled} frames")
    notes.append(f"{smoother.edge / RATE:.2f} s dropped at the ends")
    misfit = max(part.tail.misfit for part in parts)
    notes.append(f"tail markers fit the chain to {1e3 * misfit:.1f} mm")
    return tuple(notes)


def _with_roles(imported: Sequence[_Imported], held_out: Sequence[str]) -> tuple[Trial, ...]:
    trials = [(run, trial) for run in imported for trial in run.trials]
    known = {name for run, trial in trials for name in (run.name, trial.name)}
    for name in held_out:
        if name not in known:
            raise UnknownNameError("trial to hold out", name, known)
    if held_out:
        out = [run.name in held_out or trial.name in held_out for run, trial in trials]
        if all(out):
            raise InputError("all trials are held out, expected one or more to fit; name fewer of them to hold out")
    else:
        out = [not run.complete for run, _ in trials]
    roles: list[Role | None] = [None if not any(out) or all(out) else "held_out" if apart else "fit" for apart in out]
    return tuple(replace(trial, role=role) for (_, trial), role in zip(trials, roles, strict=True))
