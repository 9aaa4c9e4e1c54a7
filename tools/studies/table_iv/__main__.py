"""Simulate and fit the ranges behind the paper's Table IV.

python -m studies.table_iv --no-fit
python -m studies.table_iv --json out/table-iv.json --table out/table-iv.csv
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import pyarrow as pa
import typer
from pyarrow import csv, parquet
from rich import box
from rich.table import Table

from mjfish.errors import InputError, MjfishError
from mjfish.files.writing import check_file, write_json
from mjfish.fish import load_fish
from mjfish.fish.frames import CHANNELS, UNITS
from studies import console
from studies.table_iv import PaperComparison, compare_paper
from studies.table_iv.misfit import Fitted
from studies.table_iv.ranges import Ranges
from studies.table_iv.reasons import Reason
from studies.table_iv.sentences import removed, sentences

_NONE = "–"
#: By the suffix of a table.
_WRITERS = {".csv": csv.write_csv, ".parquet": parquet.write_table}


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    fit: Annotated[bool, typer.Option(help="Fit, or simulate with lambda* only.")] = True,
    fish: Annotated[str, typer.Option(help="Name or TOML file of a fish with a [cpg] of four joints.")] = "pike",
    seed: Annotated[int, typer.Option(min=0, help="Of the starts of the fits.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the result as JSON.")] = None,
    table: Annotated[Path | None, typer.Option(help="Write a row a mode and channel: .csv or .parquet.")] = None,
) -> None:
    """Simulate the modes of Table IV, fit their ranges, and rank the reasons for what is left."""
    try:
        for path in (json, table):
            if path is not None:
                check_file(path)
        if table is not None and table.suffix not in _WRITERS:
            raise InputError(f"{table}: unknown suffix '{table.suffix}', expected {' or '.join(_WRITERS)}; rename it")
        run(fish, fit=fit, seed=seed, jobs=jobs, json=json, table=table)
    except MjfishError as error:
        console.err.print(f"error: {error}", soft_wrap=True)
        raise typer.Exit(console.MISUSE) from None


def run(fish: str, *, fit: bool, seed: int, jobs: int | None, json: Path | None, table: Path | None) -> None:
    """Compare, show and write."""
    with console.progress_bar() as tell:
        found = compare_paper(
            load_fish(fish), fit=fit, seed=seed, jobs=jobs, tell=lambda done: tell("fitting ranges", done)
        )
    console.out.print(_ranges(found))
    units = ", ".join(f"{UNITS[channel]} ({channel})" for channel in CHANNELS)
    console.out.print(
        f"ranges in {units}; ratio: simulated / published; start-up: first ten beats; then: ten beats after a change; "
        "steady: the end; λ*, unit: the unit of beta psi alone is fitted; fitted: it and the coefficients",
        soft_wrap=True,
    )
    if found.fits is not None:
        console.out.print(_reasons(found))
        console.out.print(
            "misfit: rms of log(simulated / published) of all ranges, in brackets the share that the reason removes; "
            "* at a bound; at: " + "; ".join(_numbers(account.reason) for account in found.fits.ranked),
            soft_wrap=True,
        )
    for line in sentences(found):
        console.out.print(line, soft_wrap=True)
    if json is not None:
        write_json(json, found.to_dict() | {"says": list(sentences(found))})
    if table is not None:
        _WRITERS[table.suffix](pa.Table.from_pylist(found.rows()), table)


def _table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    shown = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in left:
        shown.add_column(heading)
    for heading in right:
        shown.add_column(heading, justify="right")
    return shown


def _ranges(found: PaperComparison) -> Table:
    fits = found.fits
    headings = ["paper", "λ*", "ratio", "start-up", "steady"]
    if fits is not None:
        headings += ["λ*, unit", "ratio", "fitted", "ratio", "start-up", "then", "steady"]
    title = f"{found.fish}: ranges of the modes of Table IV"
    shown = _table(title, ("mode", "channel"), tuple(headings))
    for i, mode in enumerate(found.modes):
        for c, channel in enumerate(CHANNELS):
            cells = [f"{found.published[i, c]:.3f}", *_simulated(found.nominal_ranges[i], found.nominal, i, c)]
            del cells[4]
            if fits is not None:
                cells += _simulated(fits.scaled_ranges[i], fits.scaled, i, c)[:2]
                cells += _simulated(fits.ranges[i], fits.fitted, i, c)
            shown.add_row(mode if c == 0 else "", channel, *cells)
        shown.add_section()
    return shown


def _simulated(ranges: Ranges, fitted: Fitted, i: int, c: int) -> list[str]:
    parts = [ranges.parts.get(part) for part in ("start_up", "change", "steady")]
    told = [_NONE if part is None else f"{part[c]:.3f}" for part in parts]
    return [f"{ranges.whole[c]:.3f}", f"{np.exp(fitted.residuals[i, c]):.2f}", *told]


def _reasons(found: PaperComparison) -> Table:
    fits = found.fits
    headings = ("alone", "at", "with coefficients", "at", "and the unit", "at")
    shown = _table("What a reason removes", ("reason",), headings)
    if fits is None:
        return shown
    before = (found.nominal.misfit, fits.coefficients.misfit, fits.fitted.misfit)
    shown.add_row("none", f"{before[0]:.3f}", "", f"{before[1]:.3f}", "", f"{before[2]:.3f}", "", end_section=True)
    for account in fits.ranked:
        cells: list[str] = []
        for one, was in zip((account.alone, account.beside, account.with_unit), before, strict=True):
            cells += _outcome(account.reason, one, was)
        shown.add_row(account.reason.name, *cells)
    return shown


def _numbers(reason: Reason) -> str:
    """Return what the numbers of a reason are called, with their units."""
    told = [f"{p.name} [{p.unit}]" for p in reason.parameters]
    return ", ".join(told)


def _outcome(reason: Reason, fitted: Fitted | None, before: float) -> tuple[str, str]:
    """Return the misfit with the share removed, and the numbers of the reason."""
    if fitted is None:
        return _NONE, ""
    share = removed(fitted.misfit, before)
    numbers = [
        f"{round(fitted.values[p.name], 5):.3g}{'*' if p.name in fitted.at_bounds else ''}" for p in reason.parameters
    ]
    return f"{fitted.misfit:.3f} ({max(share, 0.0):.0%})", ", ".join(numbers)


if __name__ == "__main__":
    app()
