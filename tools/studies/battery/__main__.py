"""The battery: sealed cases drawn, diagnosed and judged; resumes where it was stopped.

    python -m studies.battery run --split calibration --cases none:40,one:60,off_list:20,two:20
    python -m studies.battery table out/battery/calibration
    python -m studies.battery page
    python -m studies.battery foreign out/battery/foreign
    python -m studies.battery cost

Thresholds are set on calibration seeds only; every opening of the test seeds is logged in docs/battery.md.
"""

from __future__ import annotations

import json
import os
import time

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

from collections.abc import Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Annotated  # noqa: E402

import numpy as np  # noqa: E402
import typer  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from mjfish.diagnosis import diagnose  # noqa: E402
from mjfish.effects import find  # noqa: E402
from mjfish.errors import MjfishError  # noqa: E402
from mjfish.fish import load_fish  # noqa: E402
from mjfish.simulation import generate  # noqa: E402
from mjfish.study import Executing, Shard  # noqa: E402
from studies.battery import baselines, figures, foreign_figures  # noqa: E402
from studies.battery.answers import Task, judged, run, sealed_answers  # noqa: E402
from studies.battery.generator.draft import PIKE  # noqa: E402
from studies.battery.generator.foreign import FOREIGN, WEAK  # noqa: E402

OUT = Path("out/battery")
app = typer.Typer(add_completion=False, no_args_is_help=True)


def every_form(first: int, split: str, forms: Sequence[str] = ()) -> list[Task]:
    """Return two cases of every foreign form, or of `forms`: medium and weak."""
    forms = forms or [cause.name for cause in FOREIGN]
    return [
        Task("foreign", first + number, split, strength=strength, cause=form)
        for number, (strength, form) in enumerate((s, f) for s in (200.0, WEAK) for f in forms)
    ]


def tasks(
    cases: str, split: str, first: int, disturbance: str, joints: int = PIKE, noise: str | None = None
) -> list[Task]:
    """Return the tasks of e.g. ``none:40,two:20@100``, two effects of strength 100 at least.

    Kinds take turns, so that a stopped battery has some of each.
    """
    made = []
    for kind, _, rest in (entry.partition(":") for entry in cases.split(",")):
        count, _, least = rest.partition("@")
        strengths = {"least": float(least)} if least else {}
        made += [
            (
                number / int(count),
                Task(kind, first + number, split, noise=noise, disturbance=disturbance, joints=joints, **strengths),
            )
            for number in range(int(count))
        ]
    return [task for _, task in sorted(made, key=lambda one: one[0])]


@app.command("run")
def run_(
    cases: Annotated[
        str, typer.Option(help="Kinds, how many of each, @ least strength.")
    ] = "none:20,one:40,off_list:10,two:10",
    split: Annotated[str, typer.Option(help="open, calibration or test.")] = "open",
    first: Annotated[int, typer.Option(help="First seed.")] = 0,
    disturbance: Annotated[str, typer.Option(help="Force noise on top: none, forces or drift.")] = "none",
    joints: Annotated[int, typer.Option(help="Of the fish; 4 is the pike.")] = PIKE,
    observe: Annotated[str, typer.Option(help="velocity, or pose: places and headings of a camera.")] = "velocity",
    forms: Annotated[str, typer.Option(help="Foreign forms instead, medium and weak: names, or all.")] = "",
    out: Annotated[Path | None, typer.Option(help="Folder of truths and answers.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 2,
    shard: Annotated[tuple[int, int], typer.Option(help="I N: only the I-th of N shares.")] = (1, 1),
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler; 'local': one of --jobs.")] = None,
) -> None:
    """Draw, seal and diagnose cases."""
    folder = out or OUT / (split if disturbance == "none" else disturbance)
    if observe not in ("velocity", "pose"):
        raise typer.BadParameter(f"--observe is '{observe}', expected velocity or pose")
    drawn = tasks(cases, split, first, disturbance, joints, "poses" if observe == "pose" else None)
    if forms:
        drawn = every_form(first, split, [] if forms == "all" else forms.split(","))
    executing = Executing(jobs, cluster)
    ran = run(drawn, folder, shard=Shard(*shard), executing=executing, tell=lambda what, _: print(what, flush=True))
    for reason in ran.unanswered:
        print(f"missing: {reason}")
    _print(folder)


@app.command()
def table(folder: Annotated[Path, typer.Argument(help="Folder of truths and answers.")] = OUT / "open") -> None:
    """Open the truths and print the figures."""
    _print(folder)


@app.command()
def page(
    folder: Annotated[Path, typer.Argument(help="Folder of truths and answers.")] = OUT / "test",
    forces: Annotated[Path | None, typer.Option(help="The same, of cases with force noise on top.")] = None,
    target: Annotated[Path, typer.Option(help="Page whose tables are replaced.")] = Path("docs/battery.md"),
) -> None:
    """Write the figures into the page, between its markers."""
    tables = _tables(_opened(folder))
    del tables["mechanisms"]  # of foreign forms, see `foreign`
    if forces is not None:
        tables["forces"] = figures.figures(_opened(forces))
    for name, rows in tables.items():
        _put(target, name, _markdown(rows))


@app.command()
def foreign(
    folder: Annotated[Path, typer.Argument(help="Folder of truths and answers.")] = OUT / "foreign",
    target: Annotated[Path | None, typer.Option(help="Page whose tables of foreign forms are replaced.")] = None,
) -> None:
    """Open the truths: figures of mechanisms, outcomes by foreign form, and every case of one."""
    cases = _opened(folder)
    for case in cases:
        if case.truth.kind == "foreign":
            print(foreign_figures.line(case))
    if target is None:
        print("\n".join(["", _markdown(foreign_figures.figures(cases)), "", *foreign_figures.by_form(cases)]))
    else:
        _put(target, "foreign", _markdown(foreign_figures.figures(cases)))
        _put(target, "forms", "\n".join(foreign_figures.by_form(cases)))


@app.command()
def seals(
    folder: Annotated[Path, typer.Argument(help="Folder of truths and answers.")],
    target: Annotated[Path, typer.Argument(help="File of hashes and short answers, to be committed.")],
) -> None:
    """Write the hash of every sealed truth with the answer to it, and no truth, into one file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(sealed_answers(folder), indent=1) + "\n", encoding="utf-8")


@app.command()
def cost() -> None:
    """Time a diagnosis of eight trials of 10.4 s with a hidden lag, once compiled, on as many threads as cores."""
    lag = find("servo_lag")
    synthetic = generate(
        load_fish("pike"),
        ["v1", "v3", "v5", "v7", "v1-v5", "v5-v1", "v1-t1", "v3-t2"],
        values={"servo_lag.time_constant": 0.03},
        effects=[lag],
        noise=np.array([0.006, 0.006, 0.05]),
        seed=5,
        held_out=["v3", "v1-v5"],
    )
    for what in ("the first time", "once compiled"):
        begun, worked = time.perf_counter(), time.process_time()
        result = diagnose(synthetic)
        took = f"{time.perf_counter() - begun:.1f} s, {time.process_time() - worked:.1f} s of CPU"
        print(f"{what}: {took} on {os.cpu_count()} cores: {result.message}")


def _opened(folder: Path) -> list[figures.Judged]:
    cases = judged(folder)
    if not cases:
        raise typer.BadParameter(f"{folder}: no answers, expected some; make them by 'python -m studies.battery run'")
    return cases


def _put(target: Path, name: str, table: str) -> None:
    """Put a table between its markers in a page."""
    text = target.read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if begin not in text or end not in text:
        raise typer.BadParameter(f"{target}: no {begin} and {end}, expected both; put them where the table goes")
    head, _, rest = text.partition(begin)
    _, _, tail = rest.partition(end)
    target.write_text(f"{head}{begin}\n{table}\n{end}{tail}", encoding="utf-8")


def _tables(cases: Sequence[figures.Judged]) -> dict[str, list[figures.Figure]]:
    return {
        "figures": figures.figures(cases),
        "strata": figures.strata(cases),
        "guessers": baselines.compared(cases),
        "mechanisms": foreign_figures.figures(cases),
    }


def _print(folder: Path) -> None:
    console = Console()
    for name, rows in _tables(_opened(folder)).items():
        if not rows:
            continue
        shown = Table(title=f"{name}, {folder}")
        for heading in ("figure", "bar", "value", "interval", "of", ""):
            shown.add_column(heading)
        for row in rows:
            shown.add_row(*_cells(row), "" if not row.bar else "met" if row.good else "MISSED")
        console.print(shown)


def _cells(row: figures.Figure) -> tuple[str, str, str, str, str]:
    ends = row.interval
    return (
        row.what,
        row.bar,
        f"{row.value:.1%}",
        "" if ends is None else f"{ends[0]:.1%} to {ends[1]:.1%}",
        str(row.total),
    )


def _markdown(rows: Sequence[figures.Figure]) -> str:
    lines = ["| figure | bar | value | exact 95 % interval | of |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *("| " + " | ".join(_cells(row)) + " |" for row in rows)])


if __name__ == "__main__":
    try:
        app()
    except MjfishError as error:
        raise SystemExit(f"error: {error}") from None
