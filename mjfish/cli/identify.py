"""``mjfish identify``: the nine coefficients from a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from rich.markup import escape

from mjfish import fish_toml
from mjfish.cli import console, identified
from mjfish.data import load_dataset
from mjfish.data.table import check_suffix
from mjfish.diagnosis.progress import Progress
from mjfish.errors import InputError, UnknownNameError
from mjfish.estimation.identified import identified_fish, origin
from mjfish.estimation.report import Identification, identify, pose
from mjfish.estimation.settings import Loss, Settings, Weights
from mjfish.estimation.tables import write_coefficients
from mjfish.estimation.uncertainty.profile import Profile, profile
from mjfish.files import check_file, write_json


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
    profiled: Annotated[
        list[str] | None, typer.Option("--profile", help="Profile the likelihood of this parameter; repeatable.")
    ] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    table: Annotated[Path | None, typer.Option(help="Write the coefficients as CSV or Parquet.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for figures, HTML.")] = None,
    fish: Annotated[Path | None, typer.Option(help="Write the identified fish, .toml or .xml (MuJoCo).")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> None:
    """Fit the hydrodynamic coefficients to all fit trials at once, say what the data say, score held-out trials."""
    for file in (json_, table, fish):
        if file is not None:
            check_file(file)
    if fish is not None and fish.suffix not in (".toml", ".xml"):
        raise InputError(f"--fish: {fish} ends in '{fish.suffix}', expected .toml or .xml; rename it")
    if table is not None:
        check_suffix(table)
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
    measured = load_dataset(dataset)
    known = [p.name for p in pose(measured, settings).parameters]
    for name in profiled or []:
        if name not in known:
            raise UnknownNameError("free parameter of --profile", name, known)
    with console.progress_bar() as tell:
        result = identify(measured, settings, jobs=jobs, tell=lambda done: tell("fitting", done))
        profiles = _profiles(result, profiled or [], tell)
    identified.show(result, profiles)
    _write(result, profiles, json_, table, figures, fish)
    if result.fit.status != "converged":
        console.err.print(f"[bold red]{result.fit.status}:[/] {escape(result.fit.message)}", soft_wrap=True)
        raise typer.Exit(console.NOT_GOOD)


def _profiles(result: Identification, names: list[str], tell: Progress) -> list[Profile]:
    if result.assessment is None or result.problem is None:
        return []
    made = []
    for done, name in enumerate(names):
        tell(f"profiling {name}", done / len(names))
        made.append(profile(result.problem, result.fit, name, known=result.assessment.intervals))
    return made


def _write(
    result: Identification,
    profiles: list[Profile],
    json_: Path | None,
    table: Path | None,
    figures: Path | None,
    fish: Path | None,
) -> None:
    """Write what was asked for, and say what was written."""
    told = result.assessment
    written: list[Path] = []
    if json_ is not None:
        write_json(json_, {**result.to_dict(), "profiles": [one.to_dict() for one in profiles]})
        written.append(json_)
    if table is not None:
        write_coefficients(table, result.fit, None if told is None else told.intervals)
        written.append(table)
    if figures is not None and told is not None:
        from mjfish.reporting.html.identification import write_identification_figures

        written += write_identification_figures(figures, result.dataset.name, told.residuals, told.tests, profiles)
    if fish is not None:
        _write_fish(result, fish)
        written.append(fish)
    if written:
        console.out.print(f"wrote {', '.join(escape(str(file)) for file in written)}", soft_wrap=True)


def _write_fish(result: Identification, file: Path) -> None:
    fixed = result.problem.fixed if result.problem is not None else {}
    fish = identified_fish(result.dataset.fish, result.fit, fixed)
    comments = origin(result.dataset.name, result.fit, fixed)
    if file.suffix == ".toml":
        fish_toml.write(file, fish, comments)
        return
    from mjfish.mujoco import export

    export.write(file, fish, comments=comments)


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
