"""The application: its commands, and the one place where an error becomes a message and an exit code.

Every module of commands is imported to parse a command line, so none of them may import what is slow: the compiler,
MuJoCo, scipy. They reach the package through its lazy names, or import inside the command.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from mjfish.cli import (
    compare,
    console,
    data,
    dataset,
    diagnose,
    fish,
    identify,
    plan,
    render,
    simulate,
    study,
)
from mjfish.errors import MjfishError, system_refusals

_ABOUT = "Shows what a swimming-fish simulation gets wrong, names the cause, and measures what knowing it gains."


class _Group(TyperGroup):
    """Turns a user's mistake into a message and exit code 2, never a traceback, and an outcome that is not good into 1.

    A command returns whether the outcome is good; one that always is returns nothing.
    """

    def invoke(self, ctx: Any) -> None:
        try:
            with console.stoppable(lambda: "a file that was being written is whole or not there"), system_refusals():
                if super().invoke(ctx) is False:
                    raise typer.Exit(console.NOT_GOOD)
        except MjfishError as error:
            console.complain("error", str(error))
            raise typer.Exit(console.MISUSE) from None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        for command in self.commands.values():
            _escape(command)
        super().format_help(ctx, formatter)


class _Command(TyperCommand):
    """Shows help texts as they are: typer would take the brackets of a unit for markup."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        _escape(self, *self.params)
        super().format_help(ctx, formatter)


def _escape(*shown: Any) -> None:
    """Make the help texts of commands and parameters literal."""
    from rich.markup import escape

    for item in shown:
        item.help = escape(getattr(item, "help", None) or "")


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        console.say(f"mjfish {version('mjfish')}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options before the command."""


@functools.cache
def application() -> typer.Typer:
    """Return the application with every command."""
    app = typer.Typer(
        cls=_Group,
        name="mjfish",
        help=_ABOUT,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )
    app.callback(help=_ABOUT)(_root)
    commands: dict[str, Callable[..., bool | None]] = {
        "simulate": simulate.simulate,
        "export": simulate.export,
        "check": simulate.check,
        "generate": data.generate,
        "import": data.import_files,
        "compare": compare.compare,
        "identify": identify.identify,
        "inspect": data.inspect,
        "diagnose": diagnose.diagnose,
        "effects": diagnose.effects,
        "demo": diagnose.demo,
        "sample": simulate.sample,
        "plan": plan.plan,
        "study": study.study,
        "view": simulate.view,
        "render": render.render,
    }
    for name, command in commands.items():
        app.command(name, cls=_Command)(command)
    groups: dict[str, tuple[str, dict[str, Callable[..., bool | None]]]] = {
        "fish": ("Describe a fish, look at it.", {"new": fish.new, "show": fish.show}),
        "dataset": ("Make a dataset of your own recordings.", {"new": dataset.new}),
    }
    for group, (about, own) in groups.items():
        below = typer.Typer(cls=_Group, help=about, no_args_is_help=True)
        for name, command in own.items():
            below.command(name, cls=_Command)(command)
        app.add_typer(below, name=group)
    return app


def main() -> None:
    """Run the command line; a warning is a line of it."""
    warnings.showwarning = lambda message, *_: console.complain("warning", str(message))
    application()()
