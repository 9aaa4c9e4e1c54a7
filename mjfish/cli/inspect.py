"""``mjfish inspect``: what is in a dataset, what is wrong with it, and what it cannot show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.files.writing import make_folder
from mjfish.numerics.formats import number

if TYPE_CHECKING:
    from mjfish.inspection import DataReport

_COLOURS = {"blocks": "bold red", "suspect": "yellow", "remark": ""}


def inspect(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for inspection.html, a page with all channels, and inspection.json.")
    ] = None,
    json_: Annotated[
        Path | None, typer.Option("--json", help="Write the findings as JSON; - for standard output.")
    ] = None,
    effects: console.Own = None,
) -> bool:
    """Show what is in a dataset, what blocks a diagnosis, and which causes the runs cannot show. Nothing is fitted."""
    from mjfish.effects import catalogue
    from mjfish.inspection import report_on

    console.check_outputs(json_, folders=[out])
    with console.progress_bar("reading the data") as tell:
        measured = mjfish.load_dataset(dataset)
        tell("testing the data", 0.0)
        report = report_on(measured, catalogue(effects))
    if out is not None:
        make_folder(out)
        report.report(out / "inspection.html")
        report.save(out / "inspection.json")
    if not console.write_json(report, json_):
        show(report)
        if out is not None:
            console.say(f"wrote {out / 'inspection.html'} (open it in a browser) and inspection.json")
        blocks = len(report.inspection.blocks)
        mend = f"{blocks} of the findings {'blocks' if blocks == 1 else 'block'} a diagnosis; mend that first"
        then = f"nothing blocks a diagnosis; next: {console.program()} diagnose {dataset}"
        console.say(mend if blocks else then)
    return not report.inspection.blocks


def show(report: DataReport) -> None:
    """Print the runs, then what they cannot show, then the findings, worst first."""
    first = report.summary().partition("\n")[0]
    console.say((first, "bold"))
    headings = ("run", "role", "s", "Hz", "surge\nmean m/s", "sway\nrms m/s", "yaw rate\nrms rad/s", "driven by")
    table = console.table("", headings, left=("run", "role", "driven by"))
    for run in report.to_dict()["trials"]:
        sizes = (run["mean"]["surge"], run["rms"]["sway"], run["rms"]["yaw_rate"])
        role = "held out" if run["held_out"] else "fit"
        table.add_row(
            run["name"], role, f"{run['duration']:.4g}", f"{run['rate']:.4g}", *map(number, sizes), run["driven_by"]
        )
    table.caption = (
        None
        if all(trial.measured.any() for trial in report.dataset.trials)
        else "velocities are those of the smoothed path, for looking"
    )
    console.show(table)
    for reason in dict.fromkeys(report.undetectable.values()):
        names = ", ".join(name for name, own in report.undetectable.items() if own == reason)
        console.item("cannot show", f"{names}: {reason}")
    for code, unclear in report.unclear.items():
        told = "any cause" if len(unclear) + len(report.undetectable) == len(report.causes) else ", ".join(unclear)
        console.item("cannot tell", f"{told}: {code}, see below")
    for finding in report.inspection.findings:
        console.item(finding.severity, f"{finding.code}: {finding.message}", _COLOURS[finding.severity])
