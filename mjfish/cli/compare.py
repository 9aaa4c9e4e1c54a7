"""``mjfish compare``: measured trials against anyone's rollouts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.numerics.formats import NONE, number

if TYPE_CHECKING:
    from mjfish.comparison import Comparison, Shift, TrialComparison

_HEADINGS = ("trial", "channel", "RMSE", "nRMSE", "fit [%]", "start-up", "steady", "shift", "then")
#: Below the table.
_LEGEND = (
    "RMSE in m/s (surge), m/s (sway), rad/s (yaw_rate)",
    "nRMSE: RMSE over the range of the measurement; also that of the start-up, of the steady part, and 'then'",
    "fit: 100 (1 - |error| / |measured - its mean|)",
    "shift [ms]: what is measured at t agrees best with the rollout at t + shift, 'then' with this nRMSE",
)


def compare(
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
) -> bool:
    """Compare measured trials with rollouts of any simulation: columns time [s], surge [m/s], sway [m/s], ..."""
    from mjfish.data.tables import SUFFIXES, write_rows

    console.check_outputs(json_, table, suffixes=[(table, SUFFIXES)])
    result = mjfish.compare(mjfish.load_dataset(dataset), against, bound=bound)
    _show(result)
    console.write([], (json_, result.save), (table, lambda path: write_rows(path, result.rows())))
    for line in result.failures:
        console.complain("not good", line)
    return not result.failures


def _show(result: Comparison) -> None:
    shown = console.table(f"{result.dataset}: rollouts against measurements", _HEADINGS, ("trial", "channel"))
    for trial in result.trials:
        for row, cells in enumerate(_lines(trial)):
            shown.add_row(trial.trial if row == 0 else "", *cells)
        shown.add_section()
    console.show(shown)
    remarks = (remark for trial in result.trials for remark in trial.remarks)
    console.say(*_LEGEND, *(remark for remark in remarks if remark not in result.failures))
    if result.unused:
        console.say(f"named as no trial, and left alone: {', '.join(map(str, result.unused))}")


def _lines(trial: TrialComparison) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a trial: a line a channel, then all of them together."""
    if not trial.channels:
        yield ("absent" if trial.rollout is None else "no cover", *[NONE] * 7)
    scores = {(score.channel, score.part): score for score in trial.scores}
    for channel in trial.channels:
        score = scores[channel, "whole"]
        parts = (scores.get((channel, part)) for part in ("start_up", "steady"))
        others = (NONE if part is None else number(part.nrmse) for part in parts)
        shown = (number(score.rmse), number(score.nrmse), number(score.fit))
        yield (channel, *shown, *others, *_shift(trial.shifts.get(channel)))
    if "all" in trial.shifts and len(trial.channels) > 1:
        yield ("all", *[NONE] * 5, *_shift(trial.shifts["all"]))


def _shift(shift: Shift | None) -> tuple[str, str]:
    if shift is None:
        return NONE, NONE
    sign = ("≤ " if shift.time < 0.0 else "≥ ") if shift.at_limit else ""
    return f"{sign}{1000.0 * shift.time:+.1f}", number(shift.nrmse)
