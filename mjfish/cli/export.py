"""``mjfish export``: a fish as a file for others."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from mjfish import fish_toml
from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.fish import load_fish


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(export)


def export(
    fish: Annotated[str, typer.Argument(help="A shipped fish or a fish TOML.")],
    out: Annotated[Path, typer.Argument(help="File to write: .xml for MuJoCo, or .toml.")],
    set_: Annotated[list[str] | None, typer.Option("--set", help="Coefficient, e.g. c_d.head=2.0; repeatable.")] = None,
    free: Annotated[bool, typer.Option("--free", help="Free to roll, pitch and sink; .xml only.")] = False,
) -> None:
    """Write a fish as an MJCF with its water, which MuJoCo loads (mjfish.StripFluid lets it act), or as a TOML."""
    body = load_fish(fish).with_values(console.assignments(set_ or [], "--set"))
    comments = [f"The fish {body.name}, written by mjfish {version('mjfish')}.", body.about]
    if out.suffix == ".toml":
        if free:
            raise InputError("--free: a fish TOML is neither planar nor free; write an .xml, or leave out --free")
        fish_toml.write(out, body, comments[:1])
    elif out.suffix == ".xml":
        from mjfish.mujoco import Trim
        from mjfish.mujoco import export as mjcf

        mjcf.write(out, body, free=Trim() if free else None, comments=comments)
    else:
        raise InputError(f"{out}: the name ends in '{out.suffix}', expected .xml or .toml; rename it")
    console.out.print(f"wrote {escape(str(out))}", soft_wrap=True)
