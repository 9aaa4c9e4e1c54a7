"""``mjfish generate``, ``mjfish import`` and ``mjfish inspect``: make datasets, and look at what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import mjfish
from mjfish.cli import console
from mjfish.drive.modes import DURATION, MODES
from mjfish.errors import InputError
from mjfish.files.writing import make_folder
from mjfish.numerics.formats import number

if TYPE_CHECKING:
    from mjfish.data.importers import ImportReport
    from mjfish.inspection import DataReport


Force = Annotated[bool, typer.Option("--force", help="Replace a dataset that mjfish wrote to the folder.")]


def generate(
    out: Annotated[Path, typer.Option(help="Folder of the dataset.")],
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML.")] = "pike",
    modes: Annotated[str, typer.Option(help=f"Trials, of {', '.join(MODES)}.")] = "v1,v3,v5-v1,v1-t2",
    effect: Annotated[
        list[str] | None, typer.Option(help="NAME:PARAM=VALUE[,PARAM=VALUE], see `mjfish effects`; repeatable.")
    ] = None,
    effects: console.Own = None,
    observe: Annotated[
        Literal["velocity", "pose"], typer.Option(help="Of pose: places and headings of the nose.")
    ] = "velocity",
    joints: Annotated[
        Literal["cpg", "measured", "commanded"], typer.Option(help="What is recorded of the joints.")
    ] = "cpg",
    noise: Annotated[
        str | None,
        typer.Option(
            help="Sigma of surge, sway [m/s], yaw rate [rad/s]; of poses of x, y [m], heading [rad].",
            show_default="0.01,0.01,0.05; of poses 0.001,0.001,0.01",
        ),
    ] = None,
    joint_noise: Annotated[float, typer.Option(help="Sigma of measured angles [rad].", min=0.0)] = 0.0,
    rate: Annotated[float, typer.Option(help="Samples a second.")] = 50.0,
    duration: Annotated[float, typer.Option(help="Length of each trial [s].")] = DURATION,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Coefficient, e.g. c_d.head=2.0; repeatable.")] = None,
    held_out: Annotated[list[str] | None, typer.Option(help="Trial not to be fitted; repeatable.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.", min=0)] = 0,
    force: Force = False,
) -> None:
    """Generate a dataset: simulated swimming with known coefficients, noise, and effects hidden in it."""
    import numpy as np

    from mjfish.data import save
    from mjfish.effects import catalogue, of_fish

    noise = noise or ("0.01,0.01,0.05" if observe == "velocity" else "0.001,0.001,0.01")
    body = mjfish.load_fish(fish)
    known = of_fish(catalogue(effects), body)
    values = console.effect_settings(effect or [], known)
    _check_out(out, force=force)
    dataset = mjfish.generate(
        body,
        list(console.names(modes)),
        values={**console.assignments(set_ or [], "--set"), **values},
        effects=[known[name] for name in dict.fromkeys(full.partition(".")[0] for full in values)],
        noise=np.array(console.numbers(noise, 3, "--noise")),
        rate=rate,
        duration=duration,
        seed=seed,
        held_out=held_out or (),
        name=out.resolve().name,
        observe=observe,
        joints=joints,
        joint_noise=joint_noise,
    )
    console.say(f"wrote {save(dataset, out)} with {len(dataset.trials)} trials")


def import_files(
    importer: Annotated[
        str,
        typer.Argument(help="fishsim, deeplabcut, markers, mcap, poses, velocities, or a Python file with your own."),
    ],
    files: Annotated[list[Path], typer.Argument(help="Measured files.")],
    out: Annotated[Path, typer.Option(help="Folder of the dataset.")],
    map_: Annotated[
        Path | None, typer.Option("--map", help="TOML that says what columns, units and axes mean.")
    ] = None,
    held_out: Annotated[list[str] | None, typer.Option(help="Trial or file not to be fitted; repeatable.")] = None,
    force: Force = False,
) -> None:
    """Turn the files of a laboratory into a dataset."""
    from mjfish.data import importers, save

    _check_out(out, force=force)
    dataset, report = importers.import_files(importer, files, held_out or (), map_)
    path = save(dataset, out)
    show_report(report)
    console.say(f"wrote {path} with {len(dataset.trials)} trials")


def _check_out(out: Path, *, force: bool) -> None:
    """Refuse a folder that cannot be written, or that holds a dataset which nobody said to replace."""
    from mjfish.data import check_folder

    check_folder(out)
    if not force and out.exists() and any(out.iterdir()):
        raise InputError(f"{out}: holds a dataset; choose another folder, or --force to replace it")


def show_report(report: ImportReport) -> None:
    """Print what an importer did to each file."""
    from mjfish.data.importers import HEADERS

    console.say((f"{report.importer}: what was kept", "bold"))
    for row in report.rows():
        cells = zip(HEADERS[1:-1], row[1:-1], strict=True)
        console.item(row[0], ", ".join(f"{heading} {cell}" for heading, cell in cells if cell != "-"))
        for remark in filter(None, row[-1].split("; ")):
            console.item("  remark", remark)


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
    console.say((report.summary().partition("\n")[0], "bold"))
    headings = ("run", "role", "s", "Hz", "surge\nmean m/s", "sway\nrms m/s", "yaw rate\nrms rad/s", "driven by")
    table = console.table("", headings, left=("run", "role", "driven by"))
    for run in report.to_dict()["trials"]:
        sizes = (run["mean"]["surge"], run["rms"]["sway"], run["rms"]["yaw_rate"])
        table.add_row(
            run["name"],
            "held out" if run["held_out"] else "fit",
            f"{run['duration']:.4g}",
            f"{run['rate']:.4g}",
            *map(number, sizes),
            run["driven_by"],
        )
    if not all(trial.measured.any() for trial in report.dataset.trials):
        table.caption = "velocities are those of the smoothed path, for looking"
    console.show(table)
    for reason in dict.fromkeys(report.undetectable.values()):
        names = ", ".join(name for name, own in report.undetectable.items() if own == reason)
        console.item("cannot show", f"{names}: {reason}")
    for code, unclear in report.unclear.items():
        told = "any cause" if len(unclear) + len(report.undetectable) == len(report.causes) else ", ".join(unclear)
        console.item("cannot tell", f"{told}: {code}, see below")
    for finding in report.inspection.findings:
        console.item(finding.severity, f"{finding.code}: {finding.message}", _COLOURS[finding.severity])
