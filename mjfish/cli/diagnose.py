"""``mjfish diagnose``, ``mjfish demo`` and ``mjfish effects``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mjfish.cli import console, narrate
from mjfish.diagnose import Diagnosis, diagnose
from mjfish.effects import catalogue
from mjfish.trial import Dataset, load

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
    seed: Annotated[int, typer.Option(help="Of the simulated null distributions.")] = 0,
    jobs: Annotated[int | None, typer.Option(help="Threads; default one a processor.")] = None,
) -> None:
    """Find what the simulation gets wrong on measured data, name the cause, and measure the gain on held-out trials."""
    result = _run(load(dataset), effects or [], seed, jobs)
    _write(result, json_, report, rrd)
    narrate.diagnosis(result)
    _leave(result)


def demo(
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json, report.html and fish.rrd.")] = Path("out/demo"),
) -> None:
    """Run the main job on a shipped dataset with a hidden effect."""
    out.mkdir(parents=True, exist_ok=True)
    result = _run(load(DEMO), [], 0, None)
    _write(result, out / "diagnosis.json", out / "report.html", out / "fish.rrd")
    narrate.diagnosis(result)
    console.out.print(f"\nThe numbers:  {out / 'diagnosis.json'}")
    console.out.print(f"The report:   {out / 'report.html'}  (open it in a browser)")
    console.out.print(f"The swimming: mjfish view {out / 'fish.rrd'}")
    _leave(result)


def effects_(
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
) -> None:
    """List the causes that can be named, with their parameters."""
    table = Table(title="Causes", show_lines=True)
    for heading in ("cause", "parameters", "what it leaves in the residual", "what would confirm it"):
        table.add_column(heading)
    for effect in catalogue(tuple(effects or ())).values():
        parameters = "\n".join(f"{p.name} [{p.unit}]: {p.about}; {p.low:g} to {p.high:g}" for p in effect.parameters)
        table.add_row(
            f"[bold]{effect.name}[/]\n{effect.summary}",
            parameters.replace("[", r"\["),
            effect.signature,
            effect.confirm,
        )
    console.out.print(table)


def _run(dataset: Dataset, files: list[Path], seed: int, jobs: int | None) -> Diagnosis:
    known = catalogue(tuple(files))
    with console.progress_bar() as tell:
        return diagnose(dataset, effects=known, seed=seed, jobs=jobs, progress=tell)


def _write(result: Diagnosis, json_: Path | None, report: Path | None, rrd: Path | None) -> None:
    if json_ is not None:
        result.save(json_)
    if report is not None:
        from mjfish.report import write_report

        write_report(result, report)
    if rrd is not None:
        from mjfish.viewlog import write_diagnosis_log

        write_diagnosis_log(result, rrd)


def _leave(result: Diagnosis) -> None:
    if result.verdict == "unexplained" or result.status != "ok":
        raise typer.Exit(console.NOT_GOOD)
