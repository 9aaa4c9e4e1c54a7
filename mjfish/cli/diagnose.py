"""``mjfish diagnose``, ``mjfish demo`` and ``mjfish effects``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from mjfish.cli import console, narrate
from mjfish.data import Dataset, load_dataset
from mjfish.diagnosis import Diagnosis, diagnose
from mjfish.effects import Effect, catalogue
from mjfish.errors import InputError
from mjfish.files import check_file, check_folder, make_folder
from mjfish.model import extended

#: The dataset that ships with the package; what is hidden in it is not said here.
DEMO = Path(__file__).parents[1] / "demo"


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("diagnose")(diagnose_)
    app.command()(demo)
    app.command("effects")(effects_)


def diagnose_(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write diagnosis.json here.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    rrd: Annotated[Path | None, typer.Option(help="Write the rerun log here.")] = None,
    extended_: Annotated[
        Path | None, typer.Option("--extended", help="Write the extended model here, as a fish TOML to simulate.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the simulated null distributions.", min=0)] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> None:
    """Find what the simulation gets wrong on measured data, name the cause, and measure the gain on held-out trials."""
    known = catalogue(tuple(effects or ()))
    for file in (json_, report, rrd, extended_):
        if file is not None:
            check_file(file)
    if extended_ is not None and extended_.suffix != ".toml":
        raise InputError(f"--extended: {extended_} ends in '{extended_.suffix}', expected .toml; rename it")
    result = _run(load_dataset(dataset), known, seed, jobs)
    _write(result, json_, report, rrd, extended_)
    narrate.diagnosis(result, known)
    _leave(result)


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for diagnosis.json, report.html, fish.rrd and extended.toml.")
    ] = Path("out/demo"),
) -> None:
    """Run the main job on a shipped dataset with a hidden effect."""
    check_folder(out)
    result = _run(load_dataset(DEMO), catalogue(), 0, None)
    make_folder(out)
    _write(result, *(out / name for name in ("diagnosis.json", "report.html", "fish.rrd", "extended.toml")))
    narrate.diagnosis(result, catalogue())
    shown = escape(str(out))
    console.out.print(f"\nThe numbers:  {shown}/diagnosis.json", soft_wrap=True)
    console.out.print(f"The report:   {shown}/report.html  (open it in a browser)", soft_wrap=True)
    console.out.print(f"The swimming: {console.program()} view {shown}/fish.rrd", soft_wrap=True)
    swim = f"simulate --fish {shown}/extended.toml --out {shown}/swim"
    console.out.print(f"The fish now: {console.program()} {swim}", soft_wrap=True)
    _leave(result)


def effects_(
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
) -> None:
    """List the causes that can be named, with their parameters."""
    for effect in catalogue(tuple(effects or ())).values():
        console.out.print(f"[bold]{effect.name}[/]: {escape(effect.summary)}")
        rows = Table.grid(padding=(0, 2))
        rows.add_column(no_wrap=True)
        rows.add_column()
        for p in effect.parameters:
            rows.add_row(escape(f"{p.name} [{p.unit}]"), escape(f"{p.about}; {p.low:g} to {p.high:g}"))
        rows.add_row("leaves in the residual", escape(effect.signature))
        rows.add_row("would be confirmed by", escape(effect.confirm))
        console.out.print(Padding(rows, (0, 0, 1, 2)))


def _run(dataset: Dataset, known: dict[str, Effect], seed: int, jobs: int | None) -> Diagnosis:
    with console.progress_bar() as tell:
        return diagnose(dataset, effects=known, seed=seed, jobs=jobs, progress=tell)


def _write(
    result: Diagnosis, json_: Path | None, report: Path | None, rrd: Path | None, extended_: Path | None
) -> None:
    if json_ is not None:
        result.save(json_)
    if report is not None:
        from mjfish.reporting.html.diagnosis import write_diagnosis

        write_diagnosis(result, report)
    if rrd is not None:
        from mjfish.reporting.log import write_diagnosis_log

        write_diagnosis_log(result, rrd)
    if extended_ is not None:
        values = {name: value.estimate for name, value in result.extended.items()}
        extended.write(extended_, result.extended_model, values, _origin(result))


def _origin(result: Diagnosis) -> list[str]:
    """Return where the numbers of an extended fish come from, and whether its causes were named."""
    lines = [f"Fitted by mjfish diagnose to {result.dataset.name}.", f"{result.verdict}: {result.message}"]
    if result.best and result.verdict != "named":
        lines.append(f"Not named: {', '.join(result.best)}. It is in this fish as what explains most.")
    return lines


def _leave(result: Diagnosis) -> None:
    if result.verdict == "unexplained" or result.status != "ok":
        raise typer.Exit(console.NOT_GOOD)
