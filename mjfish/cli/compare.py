"""``mjfish compare``: measured trials against anyone's rollouts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from mjfish.cli import console
from mjfish.comparison import Comparison, Shift, TrialComparison, compare
from mjfish.data import load_dataset
from mjfish.data.table import check_suffix
from mjfish.estimation.agreement import Agreement
from mjfish.estimation.rows import write_rows
from mjfish.files import check_file, write_json
from mjfish.frames import CHANNELS, UNITS

_NONE = "–"
_HEADINGS = ("trial", "channel", "RMSE", "nRMSE", "fit [%]", "start-up", "steady", "shift", "then")
#: Below the table.
_LEGEND = (
    f"RMSE in {', '.join(f'{UNITS[channel]} ({channel})' for channel in CHANNELS)}",
    "nRMSE: RMSE over the range of the measurement; also that of the start-up, of the steady part, and 'then'",
    "fit: 100 (1 - |error| / |measured - its mean|)",
    "shift [ms]: what is measured at t agrees best with the rollout at t + shift, 'then' with this nRMSE",
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compare")(compare_)


def compare_(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml: what was measured.")],
    against: Annotated[
        list[Path],
        typer.Option(
            help="Folder of rollouts, CSV or Parquet named as the trials (v1.csv, v1/rollout.csv), or file; repeatable."
        ),
    ],
    bound: Annotated[float | None, typer.Option(help="Largest nRMSE that is good; beyond it, exit with 1.")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    table: Annotated[Path | None, typer.Option(help="Write a row a trial, channel and part: .csv or .parquet.")] = None,
) -> None:
    """Compare measured trials with rollouts of any simulation: columns time [s], surge [m/s], sway [m/s], ..."""
    for path in (json_, table):
        if path is not None:
            check_file(path)
    if table is not None:
        check_suffix(table)
    result = compare(load_dataset(dataset), against, bound=bound)
    _show(result)
    if json_ is not None:
        write_json(json_, result.to_dict())
    if table is not None:
        write_rows(table, result.rows())
    for line in result.failures:
        console.err.print(f"[bold red]not good:[/] {escape(line)}", soft_wrap=True)
    if result.failures:
        raise typer.Exit(console.NOT_GOOD)


def _show(result: Comparison) -> None:
    title = f"{escape(result.dataset)}: rollouts against measurements"
    shown = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in _HEADINGS:
        left = heading in ("trial", "channel")
        shown.add_column(heading, justify="left" if left else "right", no_wrap=heading != "trial")
    for one in result.trials:
        for row, cells in enumerate(_lines(one)):
            shown.add_row(escape(one.trial) if row == 0 else "", *cells)
        shown.add_section()
    console.out.print(shown)
    for line in _LEGEND:
        console.out.print(escape(line), soft_wrap=True)
    for remark in (remark for one in result.trials for remark in one.remarks):
        if remark not in result.failures:
            console.out.print(escape(remark), soft_wrap=True)
    if result.unused:
        names = ", ".join(str(path) for path in result.unused)
        console.out.print(f"named as no trial, and left alone: {escape(names)}", soft_wrap=True)


def _lines(one: TrialComparison) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a trial: a line a channel, then all of them together."""
    if not one.channels:
        yield ("absent" if one.source is None else "no cover", *[_NONE] * 7)
    scores = {(score.channel, score.part): score for score in one.scores}
    shifts = dict(one.shifts)
    for channel in one.channels:
        whole = scores[channel, "whole"]
        parts = (_part(scores.get((channel, part))) for part in ("start_up", "steady"))
        numbers = (_number(whole.rmse), _number(whole.nrmse), _number(whole.fit, ".1f"))
        yield (channel, *numbers, *parts, *_shift(shifts.get(channel)))
    if "all" in shifts and len(one.channels) > 1:
        yield ("all", *[_NONE] * 5, *_shift(shifts["all"]))


def _part(score: Agreement | None) -> str:
    return _NONE if score is None else _number(score.nrmse)


def _shift(shift: Shift | None) -> tuple[str, str]:
    if shift is None:
        return _NONE, _NONE
    sign = ("≤ " if shift.time < 0.0 else "≥ ") if shift.at_limit else ""
    return f"{sign}{1000.0 * shift.time:+.1f}", _number(shift.nrmse)


def _number(value: float, style: str = ".4f") -> str:
    return format(value, style) if math.isfinite(value) else _NONE
