"""Compare the ODE and MuJoCo, by every coupling and integrator, on the same prescribed joint motion.

python -m studies.engines
python -m studies.engines --reference FOLDER v1 v3-t2

The yardstick is the ODE at a fine step. A folder of reference trajectories has CSV files of another formulation, one a
case; every run is compared with these too. An engine is right where its error falls as its order says, and nothing is
left when the order is used to extrapolate to a vanishing step.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer
from rich import box
from rich.table import Table
from rich.text import Text

import prescribed
from mjfish.data import read_table
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError, MjfishError, UnknownNameError
from mjfish.fish import Fish, load_fish
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.model import extended
from mjfish.numerics.arrays import FloatArray
from mjfish.ode import Rollout, simulate
from mjfish.simulation import cpg_of, loads_of_mode
from studies import console

#: Exit code where an engine does not agree.
_NOT_GOOD = 1
_NONE = "–"
#: Headings of the table, those of words first.
_WORDS = ("mode", "engine", "coupling", "integrator", "verdict")
_NUMBERS = ("step", "to ODE", "to ref.", "order")

#: Longer step of an engine by its order [s]; the shorter is half of it.
STEPS = {4: 0.002, 1: 0.001}
#: Step of the yardstick [s].
FINE = 0.00025
#: Largest difference that extrapolation may leave, relative to a channel's range.
LEFT = 1e-3
#: How far the observed order may lie below the claimed one: drag is only once differentiable where a strip stops.
SLACK = 0.5
#: An rms difference this small, relative to the range, is the yardstick's own, and has no order.
_FLOOR = 1e-9


@dataclass(frozen=True)
class Case:
    """A run of the pike to compare on.

    Attributes:
        name: also of its reference trajectory, NAME.csv.
        mode: of Table IV.
        coefficients: in the order of those of the pike.
        munk: share of the Munk moment.
    """

    name: str
    mode: str
    coefficients: tuple[float, ...]
    munk: float

    @property
    def values(self) -> dict[str, float]:
        """The coefficients by name."""
        return dict(zip(load_fish("pike").coefficient_names, self.coefficients, strict=True))


_PUBLISHED = (0.01, 0.07, 0.06, 4.0, 1.5, 2.5, 0.02, 0.02, 0.02)
#: Table III's lambda* straight and slowing down, another optimum in a turn, all coefficients one with the Munk moment.
CASES = (
    Case("v1_published", "v1", _PUBLISHED, 0.0),
    Case("v5-v1_published", "v5-v1", _PUBLISHED, 0.0),
    Case("v3-t2_alternative", "v3-t2", (3.0, 0.01, 0.40, 4.0, 0.1, 0.18, 0.02, 0.010, 0.009), 0.0),
    Case("v1-t1_unit_munk", "v1-t1", (1.0,) * 6 + (0.01,) * 3, 1.0),
)


class Engine(NamedTuple):
    """Who simulates, by which coupling of the water and which integrator; the order of the integrator."""

    name: Literal["ODE", "MuJoCo"]
    coupling: Literal["inertia", "xfrc"] | None
    integrator: Literal["RK4", "Euler", "implicitfast", "implicit", "discrete"]
    order: int


#: ``xfrc`` is refused under the implicit integrators.
ENGINES = (
    Engine("ODE", None, "RK4", 4),
    Engine("MuJoCo", "inertia", "RK4", 4),
    Engine("MuJoCo", "xfrc", "RK4", 4),
    Engine("MuJoCo", "inertia", "Euler", 1),
    Engine("MuJoCo", "xfrc", "Euler", 1),
    Engine("MuJoCo", "inertia", "implicitfast", 1),
    Engine("MuJoCo", "inertia", "implicit", 1),
    Engine("MuJoCo", "inertia", "discrete", 1),
)


@dataclass(frozen=True)
class Row:
    """One engine on one case.

    Attributes:
        engine: which.
        mode: of the run.
        step: the shorter of its two steps [s].
        to_ode: largest difference to the ODE at that step, relative to the channel's range.
        to_reference: largest difference to the reference trajectory [m/s, rad/s]; NaN where there is none.
        order: of the rms difference, observed from twice the step to the step; infinite where it is rounding.
        left: largest difference after extrapolation, relative to the channel's range.
        status: ``agrees``, ``disagrees`` or ``diverged``.
    """

    engine: Engine
    mode: str
    step: float
    to_ode: float
    to_reference: float
    order: float
    left: float
    status: Literal["agrees", "disagrees", "diverged"]


def sweep(
    fish: Fish | extended.Extended,
    *,
    cases: tuple[Case, ...] = CASES,
    reference: Path | None = None,
    duration: float = modes.DURATION,
    tell: Callable[[str, float], None] | None = None,
) -> Iterator[Row]:
    """Compare every engine on every case, one row each.

    Args:
        fish: with a CPG, and effects or none; the cases add to its share of the Munk moment. Reference trajectories
            are the pike's.
        cases: runs.
        reference: folder of the reference trajectories; None: not compared.
        duration: [s].
        tell: called with what comes next and the share that is done.

    Raises:
        InputError: the fish has no CPG, an effect that such a run cannot have, or a reference trajectory is missing.
    """
    whole = extended.load(fish)
    law = cpg_of(whole.fish)
    expected = {case.name: _read(reference, case) for case in cases}
    for done, case in enumerate(cases):
        body = whole.fish.model_copy(update={"munk_moment": whole.fish.munk_moment + case.munk})
        segments = modes.drive(case.mode, body.joints)
        asked = functools.partial(cpg.joint_motion, law, segments, duration)
        given = {"values": case.values, "loads": loads_of_mode(whole, case.mode, duration)}
        truth = simulate(body, whole.drive(asked(FINE)), **given)
        for index, engine in enumerate(ENGINES):
            if tell is not None:
                tell(f"{case.mode}: {engine.name} {engine.integrator}", (done + index / len(ENGINES)) / len(cases))
            motions = [whole.drive(asked(step)) for step in (STEPS[engine.order], STEPS[engine.order] / 2)]
            runs = [_velocity(engine, body, motion, **given) for motion in motions]
            yield _row(engine, case.mode, motions, runs, truth, expected[case.name])


def _velocity(engine: Engine, fish: Fish, motion: JointMotion, **given: Any) -> FloatArray:
    """Return the velocity (n, 3) at the boundaries of the steps; shorter where the run diverged."""
    if engine.name == "ODE":
        rollout = simulate(fish, motion, **given)
        found = rollout.at(rollout.time)[:, : len(CHANNELS)]
        return found if rollout.status == "ok" else found[:0]
    run = prescribed.simulate(fish, motion, integrator=engine.integrator, coupling=engine.coupling, **given)
    return run.velocity if run.status == "ok" else run.velocity[:0]


def _row(
    engine: Engine,
    mode: str,
    motions: list[JointMotion],
    runs: list[FloatArray],
    truth: Rollout,
    expected: FloatArray | None,
) -> Row:
    """Return what two runs (n, 3), the second at half the step of the first, say of an engine."""
    times = [motion.time for motion in motions]
    order = left = to_ode = to_reference = math.nan
    status: Literal["agrees", "disagrees", "diverged"] = "diverged"
    if all(len(run) == len(time) for run, time in zip(runs, times, strict=True)):
        true = [truth.at(time)[:, : len(CHANNELS)] for time in times]
        coarse, fine = ((run - at) / np.ptp(true[1], axis=0) for run, at in zip(runs, true, strict=True))
        shared = np.searchsorted(times[1], times[0] - 1e-9)
        to_ode = float(np.abs(fine).max())
        left = float(np.abs((2**engine.order * fine[shared] - coarse) / (2**engine.order - 1)).max())
        order = math.log2(_rms(coarse) / _rms(fine)) if _rms(fine) > _FLOOR else math.inf
        status = "agrees" if order > engine.order - SLACK and left < LEFT else "disagrees"
        if expected is not None:
            at = np.searchsorted(times[1], expected[:, 0] - 1e-9)
            inside = at < len(times[1])
            if inside.any():
                to_reference = float(np.abs(runs[1][at[inside]] - expected[inside, 1:]).max())
    return Row(engine, mode, float(np.diff(times[1]).max()), to_ode, to_reference, order, left, status)


def _rms(difference: FloatArray) -> float:
    """Return the rms over the run of the worst channel; a largest difference has no clean order at kinks of drag."""
    return float(np.sqrt(np.mean(difference**2, axis=0)).max())


def _read(folder: Path | None, case: Case) -> FloatArray | None:
    """Return time, surge, sway and yaw rate (n, 4) of a case's reference trajectory."""
    if folder is None:
        return None
    path = folder / f"{case.name}.csv"
    table = read_table(path)
    for name in ("time", *CHANNELS):
        if name not in table:
            raise InputError(f"{path}: column '{name} [{UNITS.get(name, 's')}]' is missing; add it")
    if np.any(np.diff(table["time"]) <= 0.0):
        raise InputError(f"{path}: the times do not increase; sort the rows by time and remove repeated ones")
    return np.stack([table[name] for name in ("time", *CHANNELS)], axis=1)


def shown(fish: str, rows: list[Row]) -> Table:
    """Return the table of the rows, with a line between modes."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.title = f"{fish}, joints prescribed: largest differences in velocity"
    table.caption = "to ODE: of the channel's range; to ref.: in m/s and rad/s; step in ms"
    for heading in (*_WORDS[:-1], *_NUMBERS, _WORDS[-1]):
        table.add_column(heading, justify="left" if heading in _WORDS else "right")
    for row, following in zip(rows, (*rows[1:], None), strict=True):
        known = ((row.to_ode, ".1e"), (row.to_reference, ".1e"), (row.order, ".2f"))
        numbers = (_NONE if math.isnan(value) else format(value, style) for value, style in known)
        engine = (row.engine.name, row.engine.coupling or "-", row.engine.integrator)
        verdict = Text(row.status, f"bold {'green' if row.status == 'agrees' else 'red'}")
        last = following is not None and following.mode != row.mode
        table.add_row(row.mode, *engine, f"{1e3 * row.step:.3g}", *numbers, verdict, end_section=last)
    return table


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    mode: Annotated[
        list[str] | None, typer.Argument(help=f"Of {', '.join(case.mode for case in CASES)}; default all.")
    ] = None,
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML, its effects included.")] = "pike",
    reference: Annotated[
        Path | None,
        typer.Option(help="Folder of reference trajectories of the pike, CSV files.", envvar="MJFISH_REFERENCE"),
    ] = None,
) -> None:
    """Compare every engine, coupling and integrator on prescribed joints, and show the differences."""
    try:
        known = {case.mode: case for case in CASES}
        for name in mode or ():
            if name not in known:
                raise UnknownNameError("mode", name, known)
        whole = extended.load(fish)
        for line in whole.described():
            console.out.print(line, soft_wrap=True)
        cases = tuple(case for case in CASES if not mode or case.mode in mode)
        with console.progress_bar() as tell:
            rows = list(sweep(whole, cases=cases, reference=reference, tell=tell))
    except MjfishError as error:
        console.err.print(f"error: {error}", soft_wrap=True)
        raise typer.Exit(console.MISUSE) from None
    console.out.print(shown(whole.fish.name, rows))
    if reference is None:
        console.out.print("no reference trajectories: name their folder by --reference or MJFISH_REFERENCE")
    if any(row.status != "agrees" for row in rows):
        raise typer.Exit(_NOT_GOOD)


if __name__ == "__main__":
    app()
