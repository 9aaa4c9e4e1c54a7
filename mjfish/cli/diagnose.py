"""``mjfish diagnose``, ``mjfish demo`` and ``mjfish effects``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.padding import Padding
from rich.table import Table

import mjfish
from mjfish.cli import console
from mjfish.cli.diagnosis_text import show, show_splits
from mjfish.errors import InputError
from mjfish.files.writing import make_folder

if TYPE_CHECKING:
    from mjfish.diagnosis import Diagnosis, DiagnosisData, Splits

#: The datasets that ship with the package; what is hidden in them is not said here.
DEMO = Path(__file__).parents[1] / "demo"
LEARNED = DEMO / "learned"
#: What is written to a folder: numbers, report, rerun log, and the extended fish, where there is one.
_FILES = ("diagnosis.json", "report.html", "fish.rrd")
_EXTENDED = "extended.toml"

Verbose = Annotated[bool, typer.Option("--verbose", help="Show candidates, tables and all remarks, too.")]


def diagnose(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml; or a diagnosis.json, to show it again.")],
    effects: console.Own = None,
    json_: Annotated[
        Path | None, typer.Option("--json", help="Write diagnosis.json here; - for standard output.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    rrd: Annotated[Path | None, typer.Option(help="Write the rerun log here.")] = None,
    curves: Annotated[
        Path | None, typer.Option(help="Folder for the curves of the named mechanisms, a CSV each.")
    ] = None,
    extended: Annotated[Path | None, typer.Option(help="Write the extended model as a fish TOML to simulate.")] = None,
    splits: Annotated[
        int | None,
        typer.Option(
            min=1, help="Divide the runs anew so many times, diagnose each split, and say what comes how often."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for all of these files under the names of the demo, and splits.json.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the bootstrap of the gain, and of the splits.", min=0)] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
    cluster: console.Cluster = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Folder where finished refits are kept: the same command goes on where it was stopped."),
    ] = None,
    limit: Annotated[
        float | None, typer.Option(help="Seconds that one try of a candidate may take; it is left out then.")
    ] = None,
    verbose: Verbose = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show nothing but errors.")] = False,
) -> bool:
    """Find what the simulation gets wrong on measured data, name the cause, and measure the gain on held-out trials."""
    from mjfish.effects import catalogue

    console.check_outputs(
        report, rrd, extended, json_, folders=(curves, out, resume), suffixes=[(extended, (".toml",))]
    )
    means: dict[str, Any] = {"seed": seed, "jobs": jobs, "resume": resume, "limit": limit}
    divided: Splits | None = None
    written: list[Path] = []
    with console.stoppable(lambda: f"kept: {console.listed(written)}" if written else "nothing was written"):
        if dataset.suffix == ".json":
            asked = {"effects": effects, "rrd": rrd, "extended": extended, "splits": splits, "out": out}
            _check_shown_again(dataset, **asked, cluster=cluster, **means)
            result: DiagnosisData = mjfish.load_diagnosis(dataset)
        else:
            means["effects"] = catalogue(effects)
            with (
                console.progress_bar("reading the data", quiet=quiet) as tell,
                console.workers(cluster, jobs) as executor,
            ):
                result, divided = _found(dataset, splits, {**means, "executor": executor, "progress": tell})
        if out is not None:
            make_folder(out)
            json_, report, rrd, extended = (
                given or file for given, file in zip((json_, report, rrd, extended), _files(out, result), strict=True)
            )
            if divided is not None:
                divided.save(out / "splits.json")
                written.append(out / "splits.json")
        on_stdout = _write(result, (json_, report, rrd, extended), written, divided)
        if (folder := curves or (out and out / "curves")) is not None and result.write_curves(folder):
            written.append(folder)
    if not quiet and not on_stdout:
        then = _of_extended(result, extended or (out / _EXTENDED if out is not None else None), written)
        if curves is not None and curves not in written:
            then.append(("curves", f"No curve was written to {curves}: no mechanism is named whose form is a curve."))
        if rrd is not None:
            then.append(("view", f"{console.program()} view {rrd}"))
        if result.best and extended is not None:
            swim = f"{console.program()} simulate --fish {extended} --out {extended.parent / 'swim'}"
            then.append(("swim", swim))
        show(result, "DATASET" if dataset.suffix == ".json" else str(dataset), written, then, verbose=verbose)
        if divided is not None:
            show_splits(divided)
    return result.verdict != "unexplained" and result.status == "ok"


def _check_shown_again(path: Path, **options: object) -> None:
    """Refuse options that need a run where a saved diagnosis is shown again."""
    if given := [f"--{name}" for name, value in options.items() if value]:
        raise InputError(f"{path}: is a saved diagnosis, found with {', '.join(given)}; leave out what needs a run")


def _found(folder: Path, splits: int | None, means: dict[str, Any]) -> tuple[Diagnosis, Splits | None]:
    """Diagnose a dataset; where the runs are to be divided anew, that too."""
    dataset = mjfish.load_dataset(folder)
    if splits is None:
        return mjfish.diagnose(dataset, **means), None
    from mjfish.diagnosis import diagnose_splits

    divided = diagnose_splits(dataset, splits, **means)
    return divided.diagnosis, divided


def demo(
    learned: Annotated[
        bool, typer.Option("--learned", help="Another dataset: what it hides has a form that no formula has.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for diagnosis.json, report.html, fish.rrd, extended.toml and the curves.",
            show_default="out/demo; with --learned out/learned",
        ),
    ] = None,
    verbose: Verbose = False,
) -> bool:
    """Run the main job on a shipped dataset with a hidden effect."""
    out = out or Path("out/learned" if learned else "out/demo")
    return diagnose(LEARNED if learned else DEMO, out=out, verbose=verbose)


def effects(effects: console.Own = None) -> None:
    """List the causes that can be named, with their parameters."""
    from mjfish.effects import catalogue

    for effect in catalogue(effects).values():
        console.out.print(f"{effect.name}: {effect.summary}", style="bold")
        rows = Table.grid(padding=(0, 2))
        rows.add_column(no_wrap=True)
        rows.add_column()
        for p in effect.parameters:
            rows.add_row(f"{p.name} [{p.unit}]", f"{p.about}; {p.low:g} to {p.high:g}")
        rows.add_row("leaves in the residual", effect.signature)
        rows.add_row("would be confirmed by", effect.confirm)
        console.out.print(Padding(rows, (0, 0, 1, 2)))


def _files(folder: Path, result: DiagnosisData) -> tuple[Path | None, ...]:
    """Return the files that a folder gets: the extended fish only where the model was extended."""
    return (*(folder / name for name in _FILES), folder / _EXTENDED if result.best else None)


def _of_extended(result: DiagnosisData, file: Path | None, written: Sequence[Path]) -> list[tuple[str, str]]:
    """Say what the file of the extended fish has where no cause was named, or why it was not written."""
    if file is None or result.verdict == "named":
        return []
    if result.best:
        return [("extended", f"{file.name} has {' and '.join(result.best)}, which explains most and is not named.")]
    if file in written:
        return [("extended", f"{file.name} has the fitted coefficients and no cause: the model was not extended.")]
    earlier = "; the one that is there is of an earlier diagnosis" if file.exists() else ""
    return [("extended", f"No {file.name} was written: the model was not extended{earlier}.")]


def _write(
    result: DiagnosisData, files: Sequence[Path | None], written: list[Path], splits: Splits | None = None
) -> bool:
    """Write the files that are wanted, in the order of `_files`, and add each to `written` once it is there.

    Returns:
        Whether standard output has the JSON, and must have nothing else.
    """
    json_, report, rrd, extended = files
    on_stdout = console.write_json(result, json_)
    written += [json_] if json_ is not None and not on_stdout else []
    console.write(written, (report, (splits or result).report), (rrd, result.log), (extended, partial(_extend, result)))
    return on_stdout


def _extend(result: Any, path: Path) -> None:
    """Write the extended fish."""
    from mjfish.model.extended import write

    write(path, result.fish.model, result.fish.values)
