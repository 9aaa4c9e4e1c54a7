"""``mjfish generate`` and ``mjfish import``: planted and measured datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from mjfish.cli import console
from mjfish.data import check_folder, save
from mjfish.data.importers import HEADERS, IMPORTERS, import_files
from mjfish.drive import modes as table_iv
from mjfish.effects import Effect, catalogue, find
from mjfish.errors import InputError
from mjfish.fish import load_fish
from mjfish.simulation import synthetic


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(generate)
    app.command("import")(import_)


def generate(
    out: Annotated[Path, typer.Option(help="Folder of the dataset.")],
    fish: Annotated[str, typer.Option(help="A shipped fish or a fish TOML.")] = "pike",
    modes: Annotated[str, typer.Option(help=f"Trials, of {', '.join(table_iv.MODES)}.")] = "v1,v3,v5-v1,v1-t2",
    effect: Annotated[
        list[str] | None, typer.Option(help="NAME:PARAM=VALUE[,PARAM=VALUE], see `mjfish effects`; repeatable.")
    ] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
    noise: Annotated[str, typer.Option(help="Sigma of surge, sway [m/s], yaw rate [rad/s].")] = "0.01,0.01,0.05",
    rate: Annotated[float, typer.Option(help="Samples a second.")] = 50.0,
    duration: Annotated[float, typer.Option(help="Length of each trial [s].")] = table_iv.DURATION,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Coefficient, e.g. c_d.head=2.0; repeatable.")] = None,
    held_out: Annotated[list[str] | None, typer.Option(help="Trial not to be fitted; repeatable.")] = None,
    seed: Annotated[int, typer.Option(help="Of the noise.", min=0)] = 0,
) -> None:
    """Plant a dataset: simulated swimming with known coefficients, noise, and effects hidden in it."""
    hidden, values = _hidden(effect or [], catalogue(tuple(effects or ())))
    check_folder(out)
    dataset = synthetic.generate(
        load_fish(fish),
        [mode.strip() for mode in modes.split(",")],
        values={**console.assignments(set_ or [], "--set"), **values},
        effects=hidden,
        noise=np.array(console.numbers(noise, 3, "--noise")),
        rate=rate,
        duration=duration,
        seed=seed,
        held_out=held_out or (),
        name=out.resolve().name,
    )
    path = save(dataset, out)
    console.out.print(f"wrote {escape(str(path))} with {len(dataset.trials)} trials", soft_wrap=True)


def _hidden(texts: list[str], known: dict[str, Effect]) -> tuple[list[Effect], dict[str, float]]:
    """Parse ``NAME:PARAM=VALUE`` settings into effects and values by full name."""
    hidden: dict[str, Effect] = {}
    values: dict[str, float] = {}
    for text in texts:
        name, colon, settings = text.partition(":")
        if not colon or not settings:
            raise InputError(f"--effect: found '{text}', expected NAME:PARAM=VALUE, e.g. servo_lag:time_constant=0.02")
        hidden[name] = find(name, known)
        for short, value in console.assignments(settings.split(","), f"--effect {name}").items():
            full = hidden[name].declaration(short).name
            if full in values:
                raise InputError(f"--effect: '{full}' is set twice; set it once")
            values[full] = value
    return list(hidden.values()), values


def import_(
    importer: Annotated[str, typer.Argument(help=f"One of {', '.join(IMPORTERS)}, or a Python file with your own.")],
    files: Annotated[list[Path], typer.Argument(help="Measured files.")],
    out: Annotated[Path, typer.Option(help="Folder of the dataset.")],
    map_: Annotated[
        Path | None, typer.Option("--map", help="TOML that says what columns, units and axes mean.")
    ] = None,
    held_out: Annotated[list[str] | None, typer.Option(help="Trial or file not to be fitted; repeatable.")] = None,
) -> None:
    """Turn the files of a laboratory into a dataset."""
    check_folder(out)
    dataset, report = import_files(importer, files, held_out or (), map_)
    path = save(dataset, out)
    table = Table(title=escape(f"{report.importer}: what was kept"), show_header=True)
    table.add_column("", style="bold")
    for row in report.rows():
        table.add_column(row[0])
    for heading, *cells in zip(HEADERS[1:], *(row[1:] for row in report.rows()), strict=True):
        table.add_row(escape(heading), *cells, end_section=True)
    console.out.print(table)
    console.out.print(f"wrote {escape(str(path))} with {len(dataset.trials)} trials", soft_wrap=True)
