"""A folder for the next run: a dataset that lacks one recording, the command to swim, a list of what to record."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjfish import fish as fishes
from mjfish.data import Dataset, columns, write_table
from mjfish.data.dataset_toml import FILE
from mjfish.design.menu import Run
from mjfish.design.planning import Plan
from mjfish.drive import cpg as hopf
from mjfish.errors import InputError
from mjfish.files import tomlfile
from mjfish.files.writing import new_folder
from mjfish.fish import Cpg, fish_text, load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.ode.rollout import STEP

#: Samples a second of the command.
_RATE = 100.0
_FISH = "fish.toml"
_LIST = "RECORD.md"


def write_next_run(dataset: Dataset, plan: Plan, folder: Path) -> Path:
    """Write what the best run of a plan needs, whole or not at all.

    ``dataset.toml`` names the recordings that are there, which are copied, and the one to come, `NAME.csv` beside it:
    once that is measured, the folder is the dataset to diagnose again. ``NAME.command.csv`` has the joint angles to be
    driven, ``RECORD.md`` says what to do and what to record.

    Args:
        dataset: that the plan is for; read from files.
        plan: with a run driven by a CPG.
        folder: absent or empty.

    Returns:
        The dataset.toml.

    Raises:
        InputError: there is no such run, the dataset was not read from files, or the folder cannot be written.
    """
    run = next((option.run for option in plan.runs if option.run is not None and option.drive), None)
    if run is None or dataset.fish.cpg is None:
        raise InputError(f"{dataset.name}: the plan has no run that a CPG drives, so there is no drive to write")
    if dataset.source is None:
        raise InputError(
            f"{dataset.name}: was not read from a dataset.toml, which the new one is made from; save it first"
        )
    folder = folder.resolve()
    raw = tomlfile.table(dataset.source)
    shipped = raw["fish"] in fishes.shipped()
    own_fish = load_fish(raw["fish"], relative_to=dataset.source.parent)  # as its file has it, without [start]
    with new_folder(folder) as partial:
        if not shipped:
            raw["fish"] = _FISH
            (partial / _FISH).write_text(fish_text(own_fish), encoding="utf-8")
        for name in _files(raw["trials"]):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(dataset.source.parent / name, partial / name)
        raw["trials"] = _trials(raw["trials"], dataset, run)
        (partial / FILE).write_text(tomlfile.text(raw), encoding="utf-8")
        (partial / _LIST).write_text("\n".join(_list(plan, run)) + "\n", encoding="utf-8")
        write_table(partial / f"{run.name}.command.csv", _command(dataset.fish.cpg, run))
    return folder / FILE


def _files(entries: list[dict[str, Any]]) -> set[str]:
    """Return the names of all files of trials."""
    told = [*entries, *(sensor for entry in entries for sensor in entry.get("sensors", ()))]
    return {table[key] for table in told for key in ("file", "errors") if key in table}


def _trials(entries: list[dict[str, Any]], dataset: Dataset, run: Run) -> list[dict[str, Any]]:
    """Return old and new trials, every role written out: a trial more would else move the split."""
    _, held = dataset.split()
    for entry, trial in zip(entries, dataset.trials, strict=True):
        entry["role"] = "held_out" if trial in held else "fit"
    drive = [{"start": s.start, "omega": s.omega, "bias": list(s.bias)} for s in run.trial.drive]
    return [*entries, {"name": run.name, "file": f"{run.name}.csv", "role": "fit", "drive": drive}]


def _command(cpg: Cpg, run: Run) -> dict[str, Any]:
    end = float(run.trial.time[-1])
    time = np.arange(int(np.floor(end * _RATE + 1e-9)) + 1) / _RATE
    angle = hopf.joint_motion(cpg, run.trial.drive, end, STEP).angle_at(time)
    joints = {columns.header(columns.joint(j + 1)): angle[:, j] for j in range(angle.shape[1])}
    return {columns.header("time"): time, **joints}


def _list(plan: Plan, run: Run) -> Sequence[str]:
    interval = run.trial.step
    lines = [f"# {run.name}", "", plan.question.why, plan.message, ""]
    if plan.calibrations:
        lines += ["## Before swimming", ""]
        lines += [f"- [ ] {option.name}: {option.about}" for option in plan.calibrations]
        lines += [""]
    lines += ["## Swim", "", "- [ ] Let the water come to rest; the fish lies still, straight, nose along +x."]
    for segment in run.trial.drive:
        bias = ", ".join(f"{b:.3g}" for b in segment.bias)
        lines.append(f"- [ ] At {segment.start:.3g} s: omega {segment.omega:.4g} rad/s, bias {bias}.")
    lines += [
        f"- [ ] Stop at {run.trial.time[-1]:.4g} s. The joint angles are in `{run.name}.command.csv`.",
        "",
        f"## Record, in `{run.name}.csv`",
        "",
        f"- [ ] Every {interval:.4g} s from 0 s on, the drive's start: columns "
        + ", ".join(f"`{columns.header(name)}`" for name in ("time", *CHANNELS))
        + ".",
        "- [ ] The same camera, markers and clock as in the runs before; of the nose, x forward, y to port, z up.",
        f"- [ ] If the camera tracks it: {', '.join(f'`{columns.header(name)}`' for name in columns.POSE)}.",
        "",
        "Then `mjfish diagnose` this folder.",
    ]
    return lines
