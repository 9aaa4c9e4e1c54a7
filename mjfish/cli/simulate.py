"""``mjfish simulate``: a rollout of either engine."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape

from mjfish import fish as fishes
from mjfish.arrays import FloatArray
from mjfish.cli import console
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.files import check_folder, make_folder
from mjfish.fish import Fish
from mjfish.frames import CHANNELS
from mjfish.trial import columns, write_table

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
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML.")] = "pike",
    mode: Annotated[str, typer.Option(help=f"One of {', '.join(modes.MODES)}.")] = "v1",
    engine: Annotated[Engine, typer.Option(help="Head-frame ODE or MuJoCo.")] = Engine.ODE,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Coefficient, e.g. c_d.head=2.0; repeatable.")] = None,
    duration: Annotated[float, typer.Option(help="Length of the run [s].")] = modes.DURATION,
    free: Annotated[bool, typer.Option("--free", help="Free to roll, pitch and sink; --engine mujoco only.")] = False,
) -> None:
    """Simulate a mode of swimming and write rollout.csv and rollout.rrd."""
    body = fishes.load(fish).with_values(console.assignments(set_ or [], "--set"))
    if body.cpg is None:
        raise InputError(f"{fish} has no [cpg], which a mode of swimming needs; add one, or name another fish")
    if not 0.0 < duration < np.inf:
        raise InputError(f"--duration: found {duration:g}, expected a finite number above 0 s; correct it")
    if free and engine is not Engine.MUJOCO:
        raise InputError("--free: the ODE is planar; add --engine mujoco")
    check_folder(out)
    motion = cpg.joint_motion(body.cpg, modes.drive(mode), duration, STEP)
    time = np.arange(int(duration * RATE + 1e-9) + 1) / RATE
    state, joints, attitude, status, message = _run(body, motion, engine, time, free=free)
    make_folder(out)
    kept = np.all(np.isfinite(state), axis=1)
    names = ["time", *CHANNELS, *columns.POSE, *(columns.joint(k + 1) for k in range(body.joints))]
    table = np.column_stack([time, state, joints])[kept]
    if attitude is not None:
        names += columns.ATTITUDE
        attitude = attitude[kept]
        table = np.column_stack([table, attitude])
    write_table(out / "rollout.csv", {columns.header(n): table[:, k] for k, n in enumerate(names)})
    from mjfish.viewlog import write_rollout_log

    at, velocity, pose, angle = table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7 : 7 + body.joints]
    write_rollout_log(out / "rollout.rrd", body, at, velocity, pose, angle, attitude=attitude)
    if status != "ok":
        console.err.print(f"[bold red]{status}:[/] {escape(message)}", soft_wrap=True)
        raise typer.Exit(console.NOT_GOOD)
    steady = state[len(state) // 2 :, 0]
    console.out.print(
        f"{escape(body.name)}, {mode}, {engine.value}: mean surge of the second half {steady.mean():.3f} m/s"
    )
    table_file, log = escape(str(out / "rollout.csv")), escape(str(out / "rollout.rrd"))
    console.out.print(f"wrote {table_file} and {log} (open it with: {console.program()} view {log})", soft_wrap=True)


def _run(
    fish: Fish, motion: JointMotion, engine: Engine, time: FloatArray, *, free: bool
) -> tuple[FloatArray, FloatArray, FloatArray | None, str, str]:
    """Return velocity and pose (n, 6), joints, attitude or None, status and message at `time`; NaN where it ended."""
    if engine is Engine.MUJOCO:
        from mjfish import sim

        run = sim.simulate(fish, motion, free=sim.Trim() if free else None)
        series = np.column_stack([run.velocity, run.pose, run.attitude, run.joint_angle])
        at = np.column_stack([np.interp(time, run.time, column, right=np.nan) for column in series.T])
        return at[:, :6], at[:, 9:], at[:, 6:9] if free else None, run.status, run.message
    from mjfish import ode

    rollout = ode.simulate(fish, motion)
    return rollout.at(time)[:, :6], motion.angle_at(time), None, rollout.status, rollout.message
