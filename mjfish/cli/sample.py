"""``mjfish sample``: fish drawn from what a diagnosis or an identification says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.files.writing import check_new_folder


def sample(
    diagnosis: Annotated[
        Path, typer.Argument(help="JSON of `mjfish diagnose` or `identify`, or a folder with diagnosis.json.")
    ],
    out: Annotated[Path, typer.Option(help="New folder for the fish TOMLs.")],
    n: Annotated[int, typer.Option("--n", min=1, help="How many fish.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws.")] = 0,
    effects: console.Own = None,
) -> None:
    """Draw fish whose coefficients and effects have the error of the fit and the scatter from run to run."""
    from mjfish.model.posterior import write_draws

    check_new_folder(out)
    draws = mjfish.sample(diagnosis, n, seed=seed, effects=effects)
    origin = f"Drawn by mjfish sample from {diagnosis.name}, {n} draws, seed {seed}."
    files = write_draws(out, draws, [origin])
    console.say(
        f"wrote {len(files)} fish to {out}",
        f"Their band in a run: {console.program()} simulate --fish FISH --draws {out} --out DIR",
    )
