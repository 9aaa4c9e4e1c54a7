"""``mjfish fish new`` and ``mjfish fish show``: describe a fish, look at it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import mjfish
from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.files.writing import check_suffix, make_folder

if TYPE_CHECKING:
    from mjfish.fish import Fish

#: Of files of a fish.
SUFFIXES = (".xml", ".toml")
#: What a new fish says of itself at the top of its file.
_COMMENTS = (
    "A first fish: length, mass, joints and height are measured, everything else is in proportion to a robotic pike.",
    "Correct what you know, nose to tail: the length of each link (joint to joint), its mass, com (from its front",
    "joint) and inertia (about its centre of mass); the sections from the nose, height and width at both ends of each;",
    "the oscillators, if joint angles are not measured. Coefficients are textbook numbers to start from, no fit.",
    "Lengths in m, masses in kg, inertias in kg m2, angles in rad.",
)


def new(
    name: Annotated[str, typer.Argument(help="Name of the fish; its file is NAME.toml.")],
    length: Annotated[float, typer.Option(help="Length from nose to tip of the fin [m].")],
    mass: Annotated[float, typer.Option(help="Mass of the whole fish [kg].")],
    joints: Annotated[int, typer.Option(help="Number of joints, 1 to 20.")],
    height: Annotated[float, typer.Option(help="Height of the highest section of the body [m].")],
    width: Annotated[
        float | None, typer.Option(help="Width of the widest section [m]; default 0.8 of the height.")
    ] = None,
    density: Annotated[float, typer.Option(help="Density of the water [kg/m3].")] = 1000.0,
    out: Annotated[Path, typer.Option(help="Folder of the file.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a fish TOML from a few measurements, to be corrected."""
    from mjfish.fish import write_fish

    name = name.removesuffix(".toml")
    body = mjfish.new_fish(name, length=length, mass=mass, joints=joints, height=height, width=width, density=density)
    path = out / f"{name}.toml"
    if path.exists() and not force:
        raise InputError(f"{path}: is there already; give another name, or --force to replace it")
    make_folder(out)
    write_fish(path, body, _COMMENTS)
    console.say(f"wrote {path}", f"next: correct it, then {console.program()} fish show {path}")


def write(path: Path, body: Fish, comments: Sequence[str] = (), *, free: bool = False) -> None:
    """Write a fish by the suffix of its file: a TOML, or an MJCF, there also of a fish that is free to roll and sink.

    Raises:
        InputError: another suffix, or it cannot be written.
    """
    check_suffix(path, *SUFFIXES)
    if path.suffix.lower() == ".toml":
        from mjfish.fish import write_fish

        write_fish(path, body, comments)
    else:
        from mjfish.mujoco import Trim, export

        export.write(path, body, free=Trim() if free else None, comments=comments)


def show(fish: Annotated[str, typer.Argument(help="A shipped fish or a fish TOML.")]) -> None:
    """Draw a fish, list its masses and its water, and say what is odd about its numbers."""
    from mjfish.fish import read
    from mjfish.fish.body_summary import summarise

    body, _ = read(fish)
    found = summarise(body)
    total = sum(link.mass for link in body.links)
    console.say(
        f"{body.name}: {body.length:.3g} m, {total:.3g} kg, {body.joints} joint{'s' * (body.joints > 1)}",
        "",
        *found.drawing,
        "",
    )
    units = ("length\nm", "mass\nkg", "displaced\nkg", "com\nm", "inertia\nkg m2", "added\nkg", "added\nkg m2")
    table = console.table("", ("link", "group", *units), left=("link", "group"))
    for link, own in zip(body.links, found.links, strict=True):
        numbers = (link.length, link.mass, own.displaced, link.com, link.inertia, own.added, own.added_inertia)
        table.add_row(link.name, link.group, *(f"{number:.3g}" for number in numbers))
    console.show(table)
    console.say("", *(found.odd or ("Nothing is odd about its numbers.",)))
