"""``mjfish plan``: the next experiment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.files.writing import check_new_folder
from mjfish.numerics.formats import number

if TYPE_CHECKING:
    from rich.table import Table

    from mjfish.design import Option, Plan

#: Rows of the table; all of them are in the JSON.
_ROWS = 12


def plan(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    diagnosis: Annotated[Path | None, typer.Option(help="diagnosis.json of it; default: diagnose it now.")] = None,
    rivals: Annotated[str | None, typer.Option(help="Causes to tell apart, e.g. servo_lag,time_offset.")] = None,
    causes: Annotated[str | None, typer.Option(help="Causes to make visible, e.g. munk_moment.")] = None,
    effects: console.Own = None,
    duration: Annotated[
        float | None, typer.Option(help="Duration of a run [s]; default that of the longest trial.")
    ] = None,
    pause: Annotated[float, typer.Option(help="Before a run, for the water to come to rest [s].")] = 30.0,
    omega: Annotated[str | None, typer.Option(help="Slowest and fastest frequency, e.g. 9,30 [rad/s].")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write plan.json here.")] = None,
    generate_: Annotated[
        Path | None,
        typer.Option("--generate", help="New folder for the best run: drive, dataset.toml, what to record."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> bool:
    """Rank runs and calibrations by how well they would tell rival causes apart, per second of recording."""
    from mjfish.design import Menu, load_fitted_models, write_next_run

    slow, fast = console.numbers(omega, 2, "--omega") if omega is not None else (0.0, 0.0)
    menu = Menu(duration, (slow, fast) if omega is not None else None, pause)
    if rivals is not None and (diagnosis is not None or causes is not None):
        raise InputError("--rivals: found with --diagnosis or --causes, expected alone; drop one")
    console.check_outputs(json_)
    if generate_ is not None:
        check_new_folder(generate_)
    measured = mjfish.load_dataset(dataset)
    source = measured if diagnosis is None else load_fitted_models(diagnosis, measured, effects=effects)
    asked = {"rivals": console.names(rivals or ""), "causes": console.names(causes or "")}
    with console.progress_bar() as tell:
        found = mjfish.plan(source, **asked, effects=effects, menu=menu, jobs=jobs, progress=tell)
    if json_ is not None:
        found.save(json_)
    _show(found)
    if generate_ is not None:
        write_next_run(measured, found, generate_)
        console.say(f"wrote {generate_}: what to do is in {generate_}/RECORD.md")
    return found.status == "ok"


def _show(found: Plan) -> None:
    console.say((found.question.why, "bold"), found.message)
    if found.options:
        console.show(_separation(found) if found.question.purpose == "separate" else _sizes(found))
    console.say(*(f"{option.name}: {option.about}." for option in found.calibrations))
    console.say(*(f"Remark: {remark}" for remark in found.remarks))


def _separation(found: Plan) -> Table:
    from mjfish.design.planning import percent

    pairs = len(found.question.names) > 2
    headings = ("do", "seconds", *(["hardest pair"] if pairs else []), "lambda", "after", "probability", "after")
    title = f"What would tell apart {' and '.join(found.question.names)}"
    table = console.table(title, headings, ("do", "hardest pair"))
    for option in _shown(found):
        pair = option.worst
        table.add_row(
            option.name,
            f"{option.seconds:.0f}" if option.run is not None else "bench",
            *([f"{pair.first} | {pair.second}"] if pairs else []),
            number(pair.now),
            "measured" if pair.settled else number(pair.after),
            percent(pair.probability_now),
            percent(pair.probability_after),
            style=_style(option),
        )
    table.caption = (
        "lambda: misfit of the wrong cause that no refit removes; probability: of the right verdict; "
        "ranked by the gain of lambda a second"
    )
    return table


def _sizes(found: Plan) -> Table:
    headings = ("do", "seconds", "gains least", "now", "after")
    table = console.table("Minimum detectable effects", headings, ("do", "gains least"))
    for option in _shown(found):
        pair = option.worst
        cells = f"{option.seconds:.0f}", pair.first, number(pair.now), number(pair.after)
        table.add_row(option.name, *cells, style=_style(option))
    table.caption = (
        "ranked by the shrinking a second of the one that shrinks least, "
        "and of the sizes that tell apart the mechanisms that are hardest to tell apart"
    )
    return table


def _shown(found: Plan) -> list[Option]:
    """Return the best options, and the best repeat, to compare them with."""
    repeats = [option for option in found.options if option.run is not None and option.run.repeat]
    return list(dict.fromkeys((*found.options[:_ROWS], *repeats[:1])))


def _style(option: Option) -> str:
    return "green" if option.kind == "calibration" else "dim" if option.run is not None and option.run.repeat else ""
