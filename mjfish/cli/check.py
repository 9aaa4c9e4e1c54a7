"""``mjfish check``: the two engines against each other."""

from __future__ import annotations

import enum
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from mjfish.cli import console
from mjfish.drive import modes
from mjfish.errors import UnknownNameError
from mjfish.files import check_file, write_json
from mjfish.frames import CHANNELS, UNITS
from mjfish.model import extended
from mjfish.model.extended import Extended

#: Checked where no mode is named: a straight run, a change of frequency, a turn.
MODES = ("v1", "v5-v1", "v3-t2")


class Coriolis(enum.StrEnum):
    """Form of the gyroscopic terms."""

    CORRECTED = "corrected"
    PRINTED = "printed"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(check)


def check(
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML, its effects included.")] = "pike",
    mode: Annotated[list[str] | None, typer.Option(help=f"One of {', '.join(modes.MODES)}; repeatable.")] = None,
    all_: Annotated[
        bool,
        typer.Option("--all", help="Every engine, coupling and integrator, on prescribed joints; takes half a minute."),
    ] = False,
    reference: Annotated[
        Path | None,
        typer.Option(help="With --all: folder of reference trajectories, CSV files.", envvar="MJFISH_REFERENCE"),
    ] = None,
    coriolis: Annotated[
        Coriolis, typer.Option(help="The paper's printed form must be seen to fail.")
    ] = Coriolis.CORRECTED,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
) -> None:
    """Cross-check MuJoCo with the fluid force against the head-frame ODE, on the joint motion that MuJoCo realised."""
    from mjfish import simulation as crosscheck

    whole = extended.load(fish, effects or ())
    whole.check_mujoco()
    body = whole.fish
    for line in whole.told():
        console.out.print(escape(line), soft_wrap=True)
    if all_:
        _check_all(whole, mode, reference, json_)
        return
    names = mode or MODES
    for name in names:
        modes.drive(name)  # refuses an unknown mode before any work is done
    if json_ is not None:
        check_file(json_)
    crosscheck.cpg_of(body)
    results = []
    with console.progress_bar() as tell:
        for done, name in enumerate(names):
            tell(f"checking {name}", done / len(names))
            results.append(crosscheck.check(body, name, coriolis=coriolis.value, loads=whole.loads, drive=whole.drive))
    table = Table(title=f"{body.name}: largest difference ODE - MuJoCo, relative to each channel's range")
    for heading in ("mode", "step [ms]", *(f"{c} [{UNITS[c]}]" for c in CHANNELS), "of the bound", "order"):
        table.add_column(heading, justify="left" if heading == "mode" else "right")
    for result in results:
        for level, order in zip(result.levels, (math.nan, *result.orders), strict=False):
            ratios = (f"{level.ratio[channel]:.1e}" for channel in CHANNELS)
            shown = "" if math.isnan(order) else f"{order:.2f}"
            table.add_row(result.drive, f"{1e3 * level.step:g}", *ratios, f"{level.worst / result.bound:.2g}", shown)
        table.add_section()
    console.out.print(table)
    for result in results:
        colour = "green" if result.passed else "red"
        console.out.print(f"{result.drive}: [bold {colour}]{result.status}[/], {result.message}", soft_wrap=True)
    passed = all(result.passed for result in results)
    if json_ is not None:
        entries = [{**asdict(result), "passed": result.passed} for result in results]
        write_json(json_, {"schema": 1, "passed": passed, "checks": entries})
    if not passed:
        raise typer.Exit(console.NOT_GOOD)


def _check_all(whole: Extended, names: list[str] | None, reference: Path | None, json_: Path | None) -> None:
    """Compare every engine on every case, or on those of the named modes."""
    from mjfish import simulation as crosscheck

    body = whole.fish
    cases = tuple(case for case in crosscheck.CASES if not names or case.mode in names)
    for name in names or []:
        if name not in (case.mode for case in cases):
            raise UnknownNameError("mode of --all", name, [case.mode for case in crosscheck.CASES])
    if json_ is not None:
        check_file(json_)
    with console.progress_bar() as tell:
        run = crosscheck.check_all(
            body, cases=cases, reference=reference, tell=tell, loads=whole.loads, drive=whole.drive
        )
        rows = list(run)
    table = Table(
        title=f"{body.name}, joints prescribed: largest differences in velocity",
        caption="to ODE: relative to the channel's range; to ref.: in m/s and rad/s; step in ms",
        box=box.SIMPLE,
        collapse_padding=True,
        pad_edge=False,
        show_edge=False,
    )
    texts, numbers = ("mode", "engine", "coupling", "integrator"), ("step", "to ODE", "to ref.", "order")
    for heading in (*texts, *numbers, "verdict"):
        table.add_column(heading, justify="right" if heading in numbers else "left", no_wrap=True)
    for index, row in enumerate(rows):
        measured = (f"{1e3 * row.step:.3g}", f"{row.to_ode:.1e}", f"{row.to_reference:.1e}", f"{row.order:.2f}")
        shown = ("-" if text == "nan" else text for text in measured)
        colour = "green" if row.passed else "red"
        engine = (row.mode, row.engine, row.coupling, row.integrator)
        table.add_row(*engine, *shown, f"[bold {colour}]{row.status}[/]")
        if index + 1 < len(rows) and rows[index + 1].case != row.case:
            table.add_section()
    console.out.print(table)
    if reference is None:
        console.out.print("no reference trajectories: name their folder by --reference or MJFISH_REFERENCE")
    passed = all(row.passed for row in rows)
    if json_ is not None:
        write_json(
            json_, {"schema": 1, "passed": passed, "rows": [{**asdict(row), "passed": row.passed} for row in rows]}
        )
    if not passed:
        raise typer.Exit(console.NOT_GOOD)
