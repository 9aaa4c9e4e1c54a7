"""``mjfish simulate``: a rollout of either engine."""

from __future__ import annotations

import enum
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape

from mjfish import ode
from mjfish.arrays import FloatArray, readonly
from mjfish.cli import console
from mjfish.data import Trial, columns, write_table
from mjfish.drive import modes
from mjfish.errors import InputError
from mjfish.files import check_folder, make_folder
from mjfish.frames import CHANNELS
from mjfish.model import extended
from mjfish.model.extended import Extended

#: Step of both engines [s].
STEP = 0.001
#: Samples a second in rollout.csv.
RATE = 100.0


class Engine(enum.StrEnum):
    """Which engine."""

    ODE = "ode"
    MUJOCO = "mujoco"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    out: Annotated[Path, typer.Option(help="Folder for rollout.csv and rollout.rrd.")],
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML, its effects included.")] = "pike",
    mode: Annotated[str, typer.Option(help=f"One of {', '.join(modes.MODES)}.")] = "v1",
    engine: Annotated[Engine, typer.Option(help="Head-frame ODE or MuJoCo.")] = Engine.ODE,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Coefficient or effect, e.g. c_d.head=2.0; repeatable.")
    ] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
    duration: Annotated[float, typer.Option(help="Length of the run [s].")] = modes.DURATION,
    free: Annotated[bool, typer.Option("--free", help="Free to roll, pitch and sink; --engine mujoco only.")] = False,
) -> None:
    """Simulate a mode of swimming and write rollout.csv and rollout.rrd."""
    whole = extended.load(fish, effects or (), console.assignments(set_ or [], "--set"))
    body = whole.fish
    if body.cpg is None:
        raise InputError(f"{fish} has no [cpg], which a mode of swimming needs; add one, or name another fish")
    if not 0.0 < duration < np.inf:
        raise InputError(f"--duration: found {duration:g}, expected a finite number above 0 s; correct it")
    if free and engine is not Engine.MUJOCO:
        raise InputError("--free: the ODE is planar; add --engine mujoco")
    if engine is Engine.MUJOCO:
        whole.check_mujoco()
    trial = _trial(mode, duration)
    check_folder(out)
    state, joints, attitude, status, message = _run(whole, trial, engine, free=free)
    make_folder(out)
    kept = np.all(np.isfinite(state), axis=1)
    names = ["time", *CHANNELS, *columns.POSE, *(columns.joint(k + 1) for k in range(body.joints))]
    table = np.column_stack([trial.time, state, joints])[kept]
    if attitude is not None:
        names += columns.ATTITUDE
        attitude = attitude[kept]
        table = np.column_stack([table, attitude])
    write_table(out / "rollout.csv", {columns.header(n): table[:, k] for k, n in enumerate(names)})
    from mjfish.reporting.log import write_rollout_log

    at, velocity, pose, angle = table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7 : 7 + body.joints]
    write_rollout_log(out / "rollout.rrd", body, at, velocity, pose, angle, attitude=attitude)
    if status != "ok":
        console.err.print(f"[bold red]{status}:[/] {escape(message)}", soft_wrap=True)
        raise typer.Exit(console.NOT_GOOD)
    steady = state[len(state) // 2 :, 0]
    console.out.print(
        f"{escape(body.name)}, {mode}, {engine.value}: mean surge of the second half {steady.mean():.3f} m/s"
    )
    for line in whole.told():
        console.out.print(escape(line), soft_wrap=True)
    table_file, log = escape(str(out / "rollout.csv")), escape(str(out / "rollout.rrd"))
    console.out.print(f"wrote {table_file} and {log} (open it with: {console.program()} view {log})", soft_wrap=True)


def _trial(mode: str, duration: float) -> Trial:
    """Return the mode as a trial, with nothing measured in it."""
    time = np.arange(int(duration * RATE + 1e-9) + 1) / RATE
    return Trial(mode, None, readonly(time), readonly(np.zeros((len(time), len(CHANNELS)))), drive=modes.drive(mode))


def _run(
    whole: Extended, trial: Trial, engine: Engine, *, free: bool
) -> tuple[FloatArray, FloatArray, FloatArray | None, str, str]:
    """Return velocity and pose (n, 6), joints, attitude or None, status and message at the trial's times.

    They are what the camera reads; NaN where the run ended.
    """
    run = replace(whole.model, step=STEP).prepare(trial, whole.values)
    time = np.minimum(run.time, run.motion.time[-1])
    attitude = None
    if engine is Engine.MUJOCO:
        from mjfish import mujoco as sim

        swum = sim.simulate(
            run.fish, run.motion, values=run.coefficients, loads=run.loads, velocity=run.velocity,
            free=sim.Trim() if free else None,
        )  # fmt: skip
        series = np.column_stack([swum.velocity, swum.pose, np.zeros((len(swum.time), 2)), swum.attitude])
        series = np.column_stack([series, swum.joint_angle])
        at = np.column_stack([np.interp(time, swum.time, column, right=np.nan) for column in series.T])
        state, joints, attitude = at[:, :8], at[:, 11:], at[:, 8:11] if free else None
        status, message = swum.status, swum.message
    else:
        rollout = ode.simulate(run.fish, run.motion, values=run.coefficients, velocity=run.velocity, loads=run.loads)
        state, joints = rollout.at(time), run.motion.angle_at(time)
        status, message = rollout.status, rollout.message
    for effect, own in run.active:
        state = effect.reading(state, own, trial)
    return state[:, :6], joints, attitude, status, message
