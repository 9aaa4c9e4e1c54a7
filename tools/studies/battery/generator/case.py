"""Cases: a dataset to diagnose and the truth behind it.

case = scaled_case(7, "servo_lag", 120.0, "white")
diagnose(case.dataset)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from mjfish.data import Dataset, Sensor, Trial, save
from mjfish.errors import InputError
from mjfish.numerics.arrays import FloatArray, readonly
from studies.battery.generator import camera, classes, forcing, foreign, rolling, size, world
from studies.battery.generator import noise as noises
from studies.battery.generator.classes import CAUSES, LISTED, OFF_LIST, Cause
from studies.battery.generator.draft import PIKE, Draft, draft, measured_by_path
from studies.battery.generator.noise import Noise
from studies.battery.generator.truth import Truth
from studies.battery.generator.world import FINE, Disturbance

Kind = Literal["none", "one", "two", "three", "off_list", "decoy", "foreign", "foreign_pair"]
#: Range of strengths, drawn log-uniformly.
STRENGTHS = (10.0, 3000.0)


@dataclass(frozen=True, eq=False)
class Case:
    """One case.

    Attributes:
        dataset: what the solver gets.
        truth: what it does not get.
        clean: by trial, the measured velocities without noise (n, 3); not for the solver either.
        draft: behind it.
    """

    dataset: Dataset
    truth: Truth
    clean: tuple[FloatArray, ...]
    draft: Draft

    def write(self, folder: str | Path) -> Path:
        """Write the dataset folder (not the truth); return its dataset.toml."""
        return save(self.dataset, folder)


def make_case(
    seed: int,
    kind: Kind,
    *,
    split: str = "open",
    cause: str | None = None,
    strength: float | None = None,
    least: float = STRENGTHS[0],
    noise_kind: noises.Kind | None = None,
    disturbance: forcing.Kind | None = "none",
    rivals: bool = False,
    joints: int = PIKE,
) -> Case:
    """Draw a case of a kind: its causes and strengths too, where they are not given.

    Args:
        seed: 0 to 999999, of the split.
        kind: class of the truth.
        split: ``open``, ``calibration`` or ``test``.
        cause: of ``one``, ``off_list``, ``decoy``, ``foreign``; None: drawn.
        strength: lambda after refit of every cause; None: drawn from `least` to 3000, of ``foreign`` 40 or 100 to 400,
            of a ``foreign_pair``, a foreign form and a cause of the list, 100 to 1000 each.
        least: the least that is drawn.
        noise_kind: None: drawn.
        disturbance: force noise: ``none``, ``forces``, ``drift``; None: drawn.
        rivals: whether to compute the correlations with all other causes (about a second).
        joints: of the fish (`studies.battery.generator.draft.swimmer`).
    """
    if kind not in get_args(Kind):
        raise InputError(f"kind is '{kind}', expected one of {', '.join(get_args(Kind))}")
    rng = np.random.default_rng([seed, list(get_args(Kind)).index(kind), 77])
    pool = {"off_list": OFF_LIST, "decoy": classes.DECOYS}.get(kind, LISTED)
    count = {"none": 0, "two": 2, "three": 3}.get(kind, 1)
    names = [str(name) for name in rng.choice([c.name for c in pool], size=count, replace=False)]
    if cause is not None and count == 1:
        names = [cause]
    low, high = np.log((least, STRENGTHS[1]))
    drawn = [float(np.exp(rng.uniform(low, high))) if strength is None else strength for _ in names]
    if kind == "foreign":
        rng = np.random.default_rng([seed, list(get_args(Kind)).index(kind), 78])
        form, asked = foreign.draw_form(rng), foreign.draw_strength(rng)
        names, drawn = [form if cause is None else cause], [asked if strength is None else strength]
    if kind == "foreign_pair":
        form, own = foreign.draw_form(rng), classes.MECHANISMS
        others = [c.name for c in LISTED if own[c.name] != own[form]]
        names = [form, str(rng.choice(others))]
        drawn = [foreign.draw_pair_strength(rng) if strength is None else strength for _ in names]
    return scaled_case(
        seed, names, drawn, noise_kind, split=split, kind=kind, disturbance=disturbance, rivals=rivals, joints=joints
    )


def scaled_case(
    seed: int,
    cause: str | Sequence[str],
    strength: float | Sequence[float],
    noise_kind: noises.Kind | None = None,
    *,
    split: str = "open",
    kind: Kind | None = None,
    disturbance: forcing.Kind | None = "none",
    disturbance_level: float = 1.0,
    level: float | None = None,
    pose: bool | None = None,
    roll: bool | None = None,
    runs: int | None = None,
    stated: bool | None = None,
    rivals: bool = False,
    joints: int = PIKE,
) -> Case:
    """Make a case whose causes have the strengths asked for.

    Args:
        seed, split, noise_kind, disturbance, rivals, joints: as in `make_case`.
        cause: one name, or several; none at all is a case without effect.
        strength: lambda after refit over the fitted runs, one for each cause; of several, each given the others.
        kind: of the truth; None: from the causes.
        disturbance_level: rms of what force noise does to the velocities, in units of the camera's noise.
        level: of the camera's noise, 1 is 6 mm/s and 0.04 rad/s; None: drawn from 0.5 to 2.
        pose: whether the pose is recorded; None: drawn, and recorded where a cause needs it.
        roll: whether the roll is recorded; None: drawn, in one case of four.
        runs: how many; None: drawn.
        stated: whether the dataset states its sigma; None: drawn.
    """
    names = [cause] if isinstance(cause, str) else list(cause)
    wanted = [float(strength)] * len(names) if isinstance(strength, int | float) else [float(s) for s in strength]
    chosen = [CAUSES[name] for name in names]
    if any(one.needs_pose for one in chosen):
        pose = True
    made = draft(
        seed,
        split,
        noise_kind=noise_kind,
        level=level,
        pose=pose,
        roll=roll,
        runs=runs,
        bound="coefficient_at_bound" in names,
        joints=joints,
    )
    found, measure = _sized(made, chosen, wanted)
    made = with_seen_joints(made, found.psi)
    say = bool(made.rng.random() < 0.5) if stated is None else stated
    pushes, told = forcing.draw(made, disturbance, disturbance_level)
    dataset, clean = _measured(made, found.psi, pushes, say)
    correlations = {}
    if rivals and measure is not None:
        correlations = {one.name: size.rivals(measure, one, found.psi, seed) for one in chosen if len(chosen) == 1}
    parts: dict[bool, list[str]] = {True: [], False: []}
    for run in made.plan.runs:
        parts[run.held_out].append(run.name)
    truth = Truth(
        seed=seed,
        split=split,
        kind=_kind(chosen) if kind is None else kind,
        causes=tuple(names),
        psi=found.psi,
        exact={one.name: one.exact for one in chosen},
        theta=made.theta,
        strength=found.strength,
        strength_all=_over_all(made, chosen, found),
        reached=found.reached,
        absorbed=found.absorbed,
        n=sum(3 * len(t.time) for t in dataset.trials if t.role == "fit"),
        noise={**dataclasses.asdict(made.noise), "sigma": list(made.noise.sigma)},
        stated=say,
        disturbance=told,
        pose=made.plan.pose,
        roll=made.plan.roll,
        runs=(tuple(parts[False]), tuple(parts[True])),
        rho=correlations,
    )
    return Case(dataset, truth, clean, made)


def _sized(made: Draft, chosen: list[Cause], wanted: list[float]) -> tuple[size.Sized, size.Ruler | None]:
    """Draw directions and find sizes; causes without parameters have none."""
    directions = [one.draw(made.rng) for one in chosen]
    if not any(directions):
        return size.Sized({}, {}, {}, {}), None
    fitted = [i for i, run in enumerate(made.plan.runs) if not run.held_out]
    for one, direction in zip(chosen, directions, strict=True):
        if one.name == "bad_run":
            direction["bad_run.number"] = float(made.plan.runs[int(made.rng.choice(fitted))].number)
        if one.name == "wall_effect":
            direction |= _walls(made)
        if one.name == "sticking_joint":
            direction["sticking_joint.joint"] = min(direction["sticking_joint.joint"], made.fish.joints - 1.0)
        for name in [name for name in direction if name.startswith("joint_zero_offset.joint_")]:
            if int(name.rpartition("_")[2]) > made.fish.joints:
                del direction[name]
    measure = size.ruler(made, fitted)
    if chosen[0] in classes.FOREIGN and len(chosen) == 1:
        return size.sized_beyond_rivals(measure, chosen[0], directions[0], wanted[0], made.seed), measure
    return size.sized(measure, chosen, directions, wanted), measure


def _walls(made: Draft) -> dict[str, float]:
    """Return walls that stand a hand's breadth off the farthest places of all runs."""
    places = np.concatenate([made.motion(i, {}).at(made.time(i))[:, 3:5] for i in range(len(made.plan.runs))])
    (x0, y0), (x1, y1) = places.min(axis=0) - 0.1, places.max(axis=0) + 0.1
    return dict(zip(classes.WALLS, map(float, (x0, x1, y0, y1)), strict=True))


def _over_all(made: Draft, chosen: Sequence[Cause], found: size.Sized) -> dict[str, float]:
    """Return the strength of a single cause where the held-out runs are fitted too."""
    if len(chosen) != 1 or not found.psi:
        return {}
    measure = size.ruler(made, range(len(made.plan.runs)))
    return {chosen[0].name: measure.strength(found.psi)}


def _kind(chosen: Sequence[Cause]) -> Kind:
    if not chosen:
        return "none"
    if len(chosen) > 1:
        return "two" if len(chosen) == 2 else "three"
    if chosen[0] in classes.DECOYS:
        return "decoy"
    if chosen[0] in classes.FOREIGN:
        return "foreign"
    return "one" if chosen[0].listed else "off_list"


def _measured(
    made: Draft, psi: Mapping[str, float], pushes: Sequence[Disturbance | None], stated: bool
) -> tuple[Dataset, tuple[FloatArray, ...]]:
    """Swim every run finely and measure it with noise."""
    measured, clean = [], []
    for number, run in enumerate(made.plan.runs):
        moved = made.motion(number, psi, FINE, disturbance=pushes[number])
        clean.append(made.seen(number, moved, psi))
        if made.noise.kind == "poses":
            measured.append(_filmed(made, number, psi, clean[-1]))
            continue
        time, kept = made.time(number), made.kept[number]
        path = camera.pose(moved, run, psi, time)
        roll = rolling.rolled(moved, psi).at(time)[:, 0] + noises.ROLL * made.rng.standard_normal(len(time))
        velocity, path = _noisy(made.noise, clean[-1], path, kept, made.rng)
        measured.append(
            Trial(
                name=run.name,
                role="held_out" if run.held_out else "fit",
                time=readonly(time[kept]),
                velocity=readonly(velocity),
                drive=run.drive,
                pose=readonly(path[kept]) if made.plan.pose else None,
                roll=readonly(roll[kept]) if made.plan.roll else None,
                gaps=made.noise.kind == "dropped_frames",
            )
        )
    sigma = readonly(np.array(made.noise.sigma)) if stated and made.noise.kind != "poses" else None
    name = f"{made.split} {made.seed}"
    return Dataset(name, made.fish, tuple(measured), noise=sigma), tuple(clean)


def with_seen_joints(made: Draft, psi: Mapping[str, float]) -> Draft:
    """Return a draft whose joints are commanded where measured ones would show all that is wrong with them.

    An effect between what joints are told and what they do is measured with them, and nothing is wrong.
    """
    if made.noise.joints != "measured":
        return made
    for number, run in enumerate(made.plan.runs):
        told, done = (world.angles(made.fish, run, own, made.time(number)) for own in ({}, psi))
        if not np.array_equal(told, done):
            return dataclasses.replace(made, noise=dataclasses.replace(made.noise, joints="commanded"))
    return made


def _filmed(made: Draft, number: int, psi: Mapping[str, float], clean: FloatArray) -> Trial:
    """Return a run as places and headings with white noise, and its joint angles where they are recorded."""
    run, how, time = made.plan.runs[number], made.noise, readonly(made.time(number))
    seen = clean + np.array(how.sigma) * made.rng.standard_normal(clean.shape)
    sensors = (Sensor("position", "position", time, seen[:, :2]), Sensor("heading", "heading", time, seen[:, 2:]))
    angle = None
    if how.joints != "cpg":
        angle = world.angles(made.fish, run, psi if how.joints == "measured" else {}, time)
        angle = readonly(angle + (how.joints == "measured") * how.angle * made.rng.standard_normal(angle.shape))
    return Trial(
        name=run.name,
        role="held_out" if run.held_out else "fit",
        time=time,
        velocity=readonly(np.full((len(time), 3), np.nan)),
        drive=run.drive if angle is None else (),
        joint_angle=angle,
        commanded=how.joints == "commanded",
        from_rest=angle is not None,
        sensors=sensors,
    )


def _noisy(
    how: Noise, clean: FloatArray, path: FloatArray, kept: np.ndarray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return velocities with noise at the samples kept, and the pose with noise at all samples."""
    if how.kind != "differentiated_path":
        blurred = path[:: camera.FINER]
        blurred = blurred + noises.POSE * rng.standard_normal(blurred.shape)
        return clean + noises.sample(how, len(kept), rng)[kept], blurred
    blurred = path + noises.of_position(how) * rng.standard_normal(path.shape)
    floor = noises.FLOOR * np.array(how.sigma) * rng.standard_normal(clean.shape)
    return measured_by_path(how, blurred) + floor, blurred[:: camera.FINER]
