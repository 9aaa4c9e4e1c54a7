"""Which runs a result puts into a log, and what happens in them: of a diagnosis, an identification, a simulation."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mjfish import ode
from mjfish.data import Trial
from mjfish.diagnosis import Diagnosis, Overlay
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.estimation.identification import Identification
from mjfish.estimation.omnibus import beat_phase
from mjfish.fish import Fish
from mjfish.model import Model, requested_motion
from mjfish.model.model import Prepared, pose_of
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import number, percent
from mjfish.ode.forces import LinkForces, link_forces
from mjfish.ode.rollout import STEP
from mjfish.reporting.log.drawing import Drawing, arrow_scale, drawn
from mjfish.reporting.log.recording import write_runs
from mjfish.reporting.log.scene import Run, Swim, Swimmer, placed, travelled
from mjfish.reporting.titles import VERDICTS
from mjfish.simulation import Simulation

#: A step between samples longer than this many is a gap.
_GAP = 1.5
#: A joint is off its command by more than this share of the largest command.
_OFF = 0.2


#: Time [s] and words.
Event = tuple[float, str]


def events_of(trial: Trial, held_out: bool, swims: Sequence[Swim]) -> tuple[Event, ...]:
    """Return the events of a trial, in the order of their times.

    Args:
        trial: what was measured.
        held_out: whether nothing was fitted to it.
        swims: measured, then simulated; the joints of a `ghost` are those of the command.
    """
    part = "held-out run: nothing was fitted to it" if held_out else "fitted run"
    start = float(trial.time[0]), f"start of a {part}{', from rest' if trial.starts_at_rest else ''}"
    others = (*_drive(trial), *_gaps(trial), *_short(swims), *_ends(swims))
    return tuple(sorted((start, *others), key=lambda event: event[0]))


def _drive(trial: Trial) -> Iterator[Event]:
    for before, after in zip(trial.drive, trial.drive[1:], strict=False):
        changes = []
        if after.omega != before.omega:
            hertz = " to ".join(f"{segment.omega / (2.0 * math.pi):.3g}" for segment in (before, after))
            changes.append(f"the beat goes from {hertz} Hz")
        if after.bias != before.bias:
            changes.append("a turn begins" if any(after.bias) else "the turn ends")
        if changes:
            yield after.start, f"the drive changes: {' and '.join(changes)}"


def _gaps(trial: Trial) -> Iterator[Event]:
    steps = np.diff(trial.time)
    for k in np.flatnonzero(steps > _GAP * trial.step):
        yield float(trial.time[k]), f"no samples for {steps[k]:.2g} s"


def _short(swims: Sequence[Swim]) -> Iterator[Event]:
    """Yield, for each joint of each simulated fish, when it is first far off its command."""
    first, *others = swims
    for swim in others if first.ghost else ():
        asked = first.joint_angle[: len(swim.time)]
        limit = _OFF * float(np.abs(asked).max(initial=0.0))
        for joint, off in enumerate(np.abs(swim.joint_angle - asked).T, start=1):
            if limit > 0.0 and np.any(off > limit):
                k = int(np.argmax(off > limit))
                words = f"joint {joint} is {off[k]:.2g} rad off its command, for the first time"
                yield float(swim.time[k]), f"{swim.words or swim.swimmer}: {words}"


def _ends(swims: Sequence[Swim]) -> Iterator[Event]:
    last = max(float(swim.time[-1]) for swim in swims)
    for swim in swims:
        if swim.time[-1] < last - 1e-9:
            yield float(swim.time[-1]), f"{swim.words or swim.swimmer}: the simulation diverges"


@functools.singledispatch
def write_log(result: Any, path: Path) -> None:
    """Write the swimming in a result as a rerun log.

    Paths are what the velocities, measured or predicted, lead to from the measured start (or from the origin), but for
    a measured path that the trial itself has. Held-out trials come first.

    Raises:
        InputError: there is no swimming in it, or the file cannot be written.
    """
    raise InputError(f"{path}: {type(result).__name__} has no swimming to log; use report() or plot()")


@write_log.register
def _(result: Diagnosis, path: Path) -> None:
    runs = [_run(result, overlay) for overlay in sorted(result.overlays, key=lambda overlay: not overlay.held_out)]
    lines = [f"**{VERDICTS[result.verdict]}.** {result.message}"]
    if result.gain is not None:
        before, after = (percent(table["pooled"]) for table in (result.gain.nominal, result.gain.extended))
        lines.append(f"Error on held-out trials: {before} of range{f' before, {after} after' if result.best else ''}.")
    lines += [
        "Measured grey, nominal model orange, extended model teal. "
        "Forces of the water: drag red, added mass blue, what an effect adds yellow.",
        drift(runs),
    ]
    write_runs(path, runs, name=result.dataset.name, about="\n\n".join(lines), mechanisms=result.mechanisms)


@write_log.register
def _(result: Identification, path: Path) -> None:
    if result.assessment is None:
        raise InputError(f"{path}: the fit {result.fit.status} and has no swimming to log; {result.fit.message}")
    model, runs = result.problem.model, []
    values = model.values({**result.problem.fixed, **result.fit.values})
    for residual in sorted(result.assessment.residuals, key=lambda residual: residual.role == "fit"):
        nominal = simulated("nominal", model, values, residual.trial, residual.predicted)
        runs.append(_compared(residual.trial, model.fish, [nominal], residual.role == "held_out"))
    about = ["Measured grey, fitted model orange. Forces of the water: drag red, added mass blue.", drift(runs)]
    write_runs(path, runs, name=result.dataset.name, about="\n\n".join(about))


def _run(diagnosis: Diagnosis, overlay: Overlay) -> Run:
    """Return a trial with its measured and simulated swims."""
    trial = overlay.trial
    values = {name: estimate.estimate for name, estimate in diagnosis.nominal.items()}
    swims = [simulated("nominal", diagnosis.nominal_model, values, trial, overlay.nominal)]
    if diagnosis.best:  # then the arrows are drawn on the extended model alone
        values = {name: estimate.estimate for name, estimate in diagnosis.extended.items()}
        extended = simulated("extended", diagnosis.extended_model, values, trial, overlay.extended)
        swims = [replace(swims[0], forces=None), replace(extended, words=f"with {' and '.join(diagnosis.best)}")]
    return _compared(trial, diagnosis.nominal_model.fish, swims, overlay.held_out)


def _compared(trial: Trial, fish: Fish, simulated: Sequence[Swim], held_out: bool) -> Run:
    """Return a measured trial and who simulated it, with its command, the phase of its beat and its events.

    The joints of the measured fish are those of the command where nobody measured them.
    """
    motion = requested_motion(fish.cpg, trial, STEP)
    asked = motion.angle_at(np.minimum(trial.time, motion.time[-1]))
    pose, angle = trial.pose, asked if trial.joint_angle is None else trial.joint_angle
    if pose is None or not np.all(np.isfinite(pose)):
        pose = travelled(trial.time, trial.velocity, _start(trial))
    measured = Swim("measured", trial.time, trial.velocity, pose, angle, ghost=not trial.joints_measured)
    swims = (measured, *simulated)
    return Run(
        trial.name,
        fish,
        swims,
        held_out,
        command=None if trial.joints_measured else asked,
        phase=beat_phase(fish.cpg, trial),
        events=events_of(trial, held_out, swims),
    )


def drift(runs: Sequence[Run]) -> str:
    """Return in words how far apart the paths of each run end: they add up what the velocities err."""
    lines = [
        "Paths add up the errors of the velocities; the thin ones begin anew on the measured path at every beat.",
        "",
    ]
    for run in runs:
        ends = {swim.swimmer: swim.pose[-1, :2] for swim in run.swims if swim.time[-1] == run.swims[0].time[-1]}
        others = [
            f"the {who} one {number(float(np.linalg.norm(end - ends['measured'])), 2)} m"
            for who, end in ends.items()
            if who != "measured"
        ]
        if others:
            lines.append(f"- {run.name}: at the end {' and '.join(others)} from the measured nose.")
    return "\n".join(lines)


def _start(trial: Trial) -> FloatArray:
    return np.zeros(3) if trial.pose is None else np.nan_to_num(trial.pose[0])


def simulated(swimmer: Swimmer, model: Model, values: Mapping[str, float], trial: Trial, velocity: FloatArray) -> Swim:
    """Return the swim behind predicted velocities (n, 3); body and forces come from running the model once more.

    What was fitted to this trial alone is not known here: the run starts at the first predicted velocity, and a free
    clock is taken as synchronised, for the body and the arrows.

    Args:
        swimmer: who it is.
        model: that predicted.
        values: of its parameters, by name.
        trial: that it predicted.
        velocity: that it predicted; NaN where it did not get.
    """
    run = model.prepare(trial, values, velocity=None if trial.starts_at_rest else velocity[0])
    rollout = ode.simulate(
        run.fish, run.motion, values=run.coefficients, velocity=run.velocity, pose=pose_of(trial),
        coriolis=model.coriolis, loads=run.loads,
    )  # fmt: skip
    time = np.minimum(run.time, rollout.motion.time[-1])
    state = rollout.at(time)
    reached = np.isfinite(velocity).all(axis=1) & np.isfinite(state).all(axis=1)
    pose = travelled(trial.time[reached], velocity[reached], _start(trial))
    angle = rollout.motion.angle_at(time[reached])
    angle[:, -1] += state[reached, 6]
    forces = _forces(run, rollout.motion, rollout.at_steps(), time[reached], pose)
    return Swim(swimmer, trial.time[reached], velocity[reached], pose, angle, forces)


@write_log.register
def _(result: Simulation, path: Path) -> None:
    write_runs(path, [_simulated_run(result)], name=result.fish, about=result.summary())


def drawn_simulation(result: Simulation) -> Drawing:
    """Return a simulation as it is drawn."""
    run = _simulated_run(result)
    return drawn(run, arrow_scale([run]), result.fish)


def _simulated_run(result: Simulation) -> Run:
    run = result.prepared
    forces = None
    if result.attitude is None and len(result.states) > 1:
        forces = _forces(run, result.motion, result.states, run.time[: len(result.time)], result.pose)
    swim = Swim("simulated", result.time, result.velocity, result.pose, result.joint_angle, forces, result.attitude)
    command = run.motion.angle_at(np.minimum(result.time, run.motion.time[-1]))
    events = [(float(result.time[0]), "start")]
    if result.status != "ok":
        events.append((float(result.time[-1]), f"{result.status}: {result.message}"))
    return Run(result.drive, run.fish, (swim,), band=result.band, command=command, events=tuple(events))


def _forces(run: Prepared, motion: JointMotion, states: FloatArray, time: FloatArray, pose: FloatArray) -> LinkForces:
    """Return the forces on the links at times (n,) of a fish at `pose` (n, 3).

    Args:
        run: what was simulated.
        motion: of the joints.
        states: (m, 6 or more) at the boundaries of the steps of `motion`, see `mjfish.ode.forces.link_forces`.
        time: (n,) [s].
        pose: (n, 3) x, y [m], yaw [rad] of the nose at these times.
    """
    forces = link_forces(run.fish, motion, states, values=run.coefficients, loads=run.loads)
    return placed(forces, motion.time[: len(states)], states[:, 3:6], time, pose)
