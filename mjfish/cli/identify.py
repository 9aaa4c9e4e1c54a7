"""``mjfish identify``: the nine coefficients from a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from rich.markup import escape
from rich.table import Table

from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.files import check_file, write_json
from mjfish.identify.report import Identification, identify
from mjfish.identify.settings import Loss, Settings, Weights
from mjfish.trial import load

#: Correlations beyond this are printed.
_STRONG = 0.9


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("identify")(identify_)


def identify_(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    free: Annotated[list[str] | None, typer.Option(help="Pattern of what is fitted, e.g. 'c_d.*'; repeatable.")] = None,
    fix: Annotated[
        list[str] | None, typer.Option(help="Not fitted: NAME, or NAME=VALUE; patterns too; repeatable.")
    ] = None,
    bounds: Annotated[list[str] | None, typer.Option(help="NAME=LOW:HIGH, one may be left out; repeatable.")] = None,
    start: Annotated[list[str] | None, typer.Option(help="NAME=VALUE where the fit starts; repeatable.")] = None,
    loss: Annotated[str, typer.Option(help=f"One of {', '.join(get_args(Loss))}.")] = "linear",
    weights: Annotated[str, typer.Option(help="'noise', or 'paper' for its weight matrix.")] = "noise",
    starts: Annotated[int, typer.Option(min=1, help="Fits from a Latin hypercube over the bounds.")] = 16,
    seed: Annotated[int, typer.Option(min=0, help="Of the hypercube.")] = 0,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> None:
    """Fit the hydrodynamic coefficients to all fit trials at once, and score the held-out ones."""
    if json_ is not None:
        check_file(json_)
    settings = Settings(
        free=tuple(free or ("*",)),
        fixed=_fixed(fix or []),
        bounds=dict(_bounds(text) for text in bounds or []),
        start=console.assignments(start or [], "--start"),
        loss=cast("Loss", loss),
        weights=cast("Weights", weights),
        starts=starts,
        seed=seed,
    )
    measured = load(dataset)
    with console.progress_bar() as tell:
        result = identify(measured, settings, jobs=jobs, tell=lambda done: tell("fitting", done))
    _show(result)
    if json_ is not None:
        write_json(json_, result.to_dict())
    if result.fit.status != "converged":
        console.err.print(f"[bold red]{result.fit.status}:[/] {escape(result.fit.message)}", soft_wrap=True)
        raise typer.Exit(console.NOT_GOOD)


def _fixed(texts: list[str]) -> dict[str, float | None]:
    bare = [text.strip() for text in texts if "=" not in text]
    return {
        **dict.fromkeys(bare),
        **console.assignments([text for text in texts if "=" in text], "--fix"),
    }


def _bounds(text: str) -> tuple[str, tuple[float | None, float | None]]:
    name, _, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not (name and colon and (low or high)):
        raise InputError(f"--bounds: found '{text}', expected NAME=LOW:HIGH, e.g. c_d.head=0.5:3; correct it")
    what = f"--bounds {name}"
    return name, tuple(console.numbers(end, 1, what)[0] if end else None for end in (low, high))  # type: ignore[return-value]


def _show(result: Identification) -> None:
    table = Table(title=f"{escape(result.dataset.name)}: estimates with 95 % intervals")
    for heading in ("parameter", "estimate", "standard error", "low", "high", "remark"):
        table.add_column(heading, justify="left" if heading in ("parameter", "remark") else "right")
    for p, at_bound in zip(result.fit.parameters, result.fit.at_bound, strict=True):
        low, high = result.fit.interval(p.name)
        remark = "rests on its bound" if at_bound else ""
        cells = (f"{v:.4g}" for v in (result.fit.values[p.name], result.fit.sigma[p.name], low, high))
        table.add_row(p.name, *cells, remark)
    console.out.print(table)
    scores = Table(title="nRMSE (RMSE over the range of the channel)")
    for heading in ("trial", "role", "surge", "sway", "yaw_rate"):
        scores.add_column(heading, justify="left" if heading in ("trial", "role") else "right")
    for row in result.scores:
        scores.add_row(row.trial, row.role, *(f"{v:.4f}" for v in row.nrmse))
    console.out.print(scores)
    for first, second, value in result.strong_correlations(_STRONG):
        console.out.print(f"{first} and {second} are hard to tell apart on these data: correlation {value:.2f}")
    if result.starts > 1:
        console.out.print(f"{round(result.reached * result.starts)} of {result.starts} starts reached the best optimum")
    for remark in result.remarks:
        console.out.print(remark)
    console.out.print(f"fit {result.fit.status} after {result.fit.evaluations} evaluations")
