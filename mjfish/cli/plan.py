"""``mjfish plan``: the next experiment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.files import check_file
from mjfish.reporting.words import number

if TYPE_CHECKING:
    from rich.table import Table

    from mjfish.design import Option, Plan, Question

#: Rows of the table; all of them are in the JSON.
_ROWS = 12


def plan(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    diagnosis: Annotated[Path | None, typer.Option(help="diagnosis.json of it; default: diagnose it now.")] = None,
    rivals: Annotated[str | None, typer.Option(help="Causes to tell apart, e.g. servo_lag,time_offset.")] = None,
    causes: Annotated[str | None, typer.Option(help="Causes to make visible, e.g. munk_moment.")] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")] = None,
    duration: Annotated[float | None, typer.Option(help="Of a run [s]; default that of the longest trial.")] = None,
    pause: Annotated[float, typer.Option(help="Before a run, for the water to come to rest [s].")] = 30.0,
    omega: Annotated[str | None, typer.Option(help="Slowest and fastest frequency, e.g. 9,30 [rad/s].")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write plan.json here.")] = None,
    generate_: Annotated[
        Path | None,
        typer.Option("--generate", help="New folder for the best run: drive, dataset.toml, what to record."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> None:
    """Rank runs and calibrations by how well they would tell rival causes apart a second."""
    from mjfish.design import Menu, advise, generate, skeleton
    from mjfish.effects import catalogue

    known = catalogue(tuple(effects or ()))
    slow, fast = console.numbers(omega, 2, "--omega") if omega is not None else (0.0, 0.0)
    menu = Menu(duration, (slow, fast) if omega is not None else None)
    if json_ is not None:
        check_file(json_)
    if generate_ is not None:
        skeleton.check_folder(generate_)
    measured = mjfish.load_dataset(dataset)
    question = _question(diagnosis, rivals, causes, measured.name)
    with console.progress_bar() as tell:
        if question is None:
            found = mjfish.plan(measured, effects=known, menu=menu, pause=pause, jobs=jobs, progress=tell)
        else:
            found = advise(measured, question, effects=known, menu=menu, pause=pause, jobs=jobs, progress=tell)
    if json_ is not None:
        found.save(json_)
    _show(found)
    if generate_ is not None:
        generate(measured, found, generate_)
        console.say(f"wrote {generate_}: what to do is in {generate_}/RECORD.md")
    if found.status != "ok":
        raise typer.Exit(console.NOT_GOOD)


def _question(diagnosis: Path | None, rivals: str | None, causes: str | None, name: str) -> Question | None:
    from mjfish.design import Question
    from mjfish.design.question import of_file

    if rivals is not None and (diagnosis is not None or causes is not None):
        raise InputError("--rivals: found with --diagnosis or --causes, expected alone; drop one")
    if rivals is not None:
        return Question("separate", console.names(rivals), "Rivals named by hand.")
    asked = console.names(causes or "")
    if diagnosis is not None:
        return of_file(diagnosis, name, asked)
    return Question("see", asked, "Causes named by hand.") if causes is not None else None


def _show(found: Plan) -> None:
    console.say((found.question.why, "bold"), found.message)
    if found.options:
        console.out.print(_separation(found) if found.question.purpose == "separate" else _sizes(found))
    calibrations = (option for option in found.options if option.kind == "calibration")
    console.say(*(f"{option.name}: {option.about}." for option in calibrations))
    console.say(*(f"Remark: {remark}" for remark in found.remarks))


def _separation(found: Plan) -> Table:
    from mjfish.design.words import percent

    pairs = len(found.question.names) > 2
    headings = ("do", "seconds", *(["hardest pair"] if pairs else []), "lambda", "after", "chance", "after")
    title = f"What would tell apart {' and '.join(found.question.names)}"
    table = console.table(title, headings, ("do", "hardest pair"))
    for option in _shown(found):
        pair = option.worst
        after = "measured" if pair.settled else number(pair.after)
        seconds = f"{option.seconds:.0f}" if option.run is not None else "bench"
        hardest = [f"{pair.first} | {pair.second}"] if pairs else []
        chances = percent(pair.chance_now), percent(pair.chance_after)
        table.add_row(option.name, seconds, *hardest, number(pair.now), after, *chances, style=_style(option))
    table.caption = (
        "lambda: misfit of the wrong cause that no refit hides; chance: that the right one is then told; "
        "ranked by the gain of lambda a second"
    )
    return table


def _sizes(found: Plan) -> Table:
    headings = ("do", "seconds", "gains least", "now", "after")
    table = console.table("Smallest sizes that would show", headings, ("do", "gains least"))
    for option in _shown(found):
        pair = option.worst
        cells = f"{option.seconds:.0f}", pair.first, number(pair.now), number(pair.after)
        table.add_row(option.name, *cells, style=_style(option))
    table.caption = "ranked by the shrinking a second of the size that shrinks least"
    return table


def _shown(found: Plan) -> list[Option]:
    """Return the best options, and the best repeat, to compare them with."""
    best = list(found.options[:_ROWS])
    repeats = [option for option in found.options if option.run is not None and option.run.repeat]
    return best + [option for option in repeats[:1] if option not in best]


def _style(option: Option) -> str:
    return "green" if option.kind == "calibration" else "dim" if option.run is not None and option.run.repeat else ""
