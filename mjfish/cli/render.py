"""``mjfish render``: a film or a still of a fish, a rollout or a diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.errors import InputError, UnknownNameError
from mjfish.files.writing import check_file, check_suffix

if TYPE_CHECKING:
    from mjfish.reporting.log.drawing import Drawing

#: Logs that are looked for in a folder: of `mjfish diagnose` and of `mjfish simulate`.
_LOGS = ("fish.rrd", "rollout.rrd")
#: How long a fish swims before its last beats are shown [s].
_SWIMS = 6.0


def render(
    what: Annotated[
        str,
        typer.Argument(
            metavar="FISH|ROLLOUT|DIAGNOSIS",
            help="A shipped fish, a fish TOML, a folder of `mjfish simulate --out` or `diagnose --out`, or a .rrd.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="File to write: .mp4, .gif, or .png with several instants in one picture.")],
    trial: Annotated[
        str | None,
        typer.Option(help="Run of a diagnosis to show.", show_default="the held-out one with the largest error"),
    ] = None,
) -> None:
    """Draw a swimming fish with the forces of the water on it; of a diagnosis, the measured and both simulated fish."""
    from mjfish.reporting import film
    from mjfish.reporting.log.reading import read_log

    check_file(out)
    check_suffix(out, *film.SUFFIXES)
    log = _log(Path(what))
    with console.progress_bar() as tell:
        tell("looking at what swims", 0.0)
        beats = film.BEATS_OF_STILL if out.suffix.lower() == ".png" else film.BEATS
        if log is None:
            stretch = film.steady(_of_fish(what, trial), beats)
        else:
            drawing = _chosen(read_log(log), trial)
            stretch = film.whole(drawing) if drawing.held_out is None else film.worst(drawing, beats)
        film.write(out, stretch, tell)
    console.say(f"wrote {out}: {stretch.drawing.name}, {stretch.start:.2f} to {stretch.end:.2f} s")


def _log(path: Path) -> Path | None:
    """Return the log that a path stands for; None: it is a fish."""
    if path.suffix in (".json", ".csv", ".html"):
        raise InputError(f"{path}: expected a fish TOML, a log (.rrd) or a folder with one; name its folder")
    if path.suffix == ".rrd":
        if not path.is_file():
            raise InputError(f"{path}: no such file; name a log, or a folder of `mjfish simulate` or `mjfish diagnose`")
        return path
    if not path.is_dir():
        return None
    for log in (path / name for name in _LOGS):
        if log.is_file():
            return log
    raise InputError(
        f"{path}: has neither {_LOGS[0]} nor {_LOGS[1]}; make one by `mjfish diagnose DATASET --out {path}` "
        f"or `mjfish simulate --out {path}`"
    )


def _of_fish(fish: str, trial: str | None) -> Drawing:
    """Let a fish swim by its CPG, or by a wave where it has none."""
    from mjfish.drive.wave import travelling
    from mjfish.fish import read as read_fish
    from mjfish.reporting.log.results import drawn_simulation

    if trial is not None:
        raise InputError(f"--trial: {fish} is a fish and has no trials; leave it out, or name a diagnosis")
    body = read_fish(fish)[0]
    drive = None if body.cpg is not None else travelling(tuple(link.length for link in body.links))
    run = mjfish.simulate(fish, drive=drive, duration=_SWIMS)
    if run.status != "ok":
        raise InputError(f"{fish}: its run {run.message}; mend the fish before it is drawn")
    return drawn_simulation(run)


def _chosen(drawings: list[Drawing], trial: str | None) -> Drawing:
    """Return the drawing of a trial: the named one, else where the nominal fish errs most, held-out ones first."""
    named = {drawing.name: drawing for drawing in drawings}
    if trial is not None:
        if trial not in named:
            raise UnknownNameError("trial", trial, named)
        return named[trial]

    def error(drawing: Drawing) -> tuple[bool, float]:
        errors = [figure.error or 0.0 for figure in drawing.figures if figure.swimmer == "nominal"]
        return drawing.held_out is True, max(errors, default=0.0)

    return max(drawings, key=error)
