"""The log of a diagnosis: every trial as measured, as the nominal and as the extended model swim it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.diagnosis import Diagnosis, Estimate, Overlay
from mjfish.model import Model
from mjfish.ode.forces import link_forces
from mjfish.reporting.log.recording import write_log
from mjfish.reporting.log.scene import Run, Swim, Swimmer, placed, travelled
from mjfish.reporting.words import VERDICTS


def write_diagnosis_log(diagnosis: Diagnosis, path: Path) -> None:
    """Write every trial of a diagnosis to an .rrd file, held-out trials first.

    Paths are what the velocities, measured or predicted, lead to from the measured start (or from the origin), but for
    a measured path that the trial itself has.

    Raises:
        InputError: the file cannot be written.
    """
    overlays = sorted(diagnosis.overlays, key=lambda overlay: not overlay.held_out)
    write_log(
        path, [_run(diagnosis, overlay) for overlay in overlays], name=diagnosis.dataset.name, about=_about(diagnosis)
    )


def _run(diagnosis: Diagnosis, overlay: Overlay) -> Run:
    """Return a trial with its measured and simulated swims."""
    trial = overlay.trial
    nominal = _simulated("nominal", diagnosis.nominal_model, diagnosis.nominal, trial, overlay.nominal)
    swims: tuple[Swim, ...] = (_measured(trial), nominal)
    if diagnosis.best:  # then the arrows are drawn on the extended model alone
        model, estimates = diagnosis.extended_model, diagnosis.extended
        extended = _simulated("extended", model, estimates, trial, overlay.extended)
        swims = (swims[0], replace(nominal, forces=None), extended)
    return Run(trial.name, diagnosis.nominal_model.fish, swims, overlay.held_out)


def _start(trial: Trial) -> FloatArray:
    return np.zeros(3) if trial.pose is None else np.nan_to_num(trial.pose[0])


def _measured(trial: Trial) -> Swim:
    pose = trial.pose
    if pose is None or not np.all(np.isfinite(pose)):
        pose = travelled(trial.time, trial.velocity, _start(trial))
    return Swim("measured", trial.time, trial.velocity, pose, trial.joint_angle)


def _simulated(
    swimmer: Swimmer, model: Model, estimates: Mapping[str, Estimate], trial: Trial, velocity: FloatArray
) -> Swim:
    """Return the swim behind predicted velocities (n, 3); body and forces come from running the model once more.

    What was fitted to this trial alone is not known here: the run starts at the first predicted velocity, and a free
    clock is taken as synchronised, for the body and the arrows.
    """
    values = {name: estimate.estimate for name, estimate in estimates.items()}
    start = None if trial.starts_at_rest else velocity[0]
    rollout = model.predict(trial, values, velocity=start).rollout
    taken = trial.time
    fish, loads = model.fish, []
    for effect in model.effects:
        own = {p.short: values[p.name] for p in effect.parameters}
        if not effect.is_null(own):
            fish, taken = effect.body(fish, own), effect.clock(taken, own)
            loads += [(effect.load, list(own.values()))] if effect.load is not None else []
    taken = np.minimum(taken, rollout.motion.time[-1])
    state = rollout.at(taken)
    reached = np.isfinite(velocity).all(axis=1) & np.isfinite(state).all(axis=1)
    pose = travelled(trial.time[reached], velocity[reached], _start(trial))
    angle = rollout.motion.angle_at(taken[reached])
    angle[:, -1] += state[reached, 6]
    at_steps = np.concatenate([rollout.state[:, 0], rollout.state[-1:, 1]])
    at_steps[:, 3:6] = 0.0  # forces as the nose sees them; the pose is that of the log
    coefficients = {p.name: values[p.name] for p in model.fish.parameters}
    forces = link_forces(fish, rollout.motion, at_steps, values=coefficients, loads=loads)
    shown = placed(forces, rollout.time, taken[reached], pose)
    return Swim(swimmer, trial.time[reached], velocity[reached], pose, angle, shown)


def _about(diagnosis: Diagnosis) -> str:
    lines = [
        f"**{VERDICTS[diagnosis.verdict]}.** {diagnosis.message}",
        "Measured grey, nominal model orange, extended model teal. "
        "Forces of the water: drag red, added mass blue, what an effect adds yellow.",
    ]
    if diagnosis.gain is not None:
        before, after = (100.0 * table["pooled"] for table in (diagnosis.gain.nominal, diagnosis.gain.extended))
        lines.insert(1, f"Error on held-out trials: {before:.2f} % of range before, {after:.2f} % after.")
    return "\n\n".join(lines)
