"""The application: commands, and the one place where an error becomes an exit code."""

from __future__ import annotations

import functools
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

from mjfish.cli import console
from mjfish.errors import MjfishError


class _Group(TyperGroup):
    """Turns a user's mistake into a message and exit code 2, never a traceback."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except MjfishError as error:
            console.err.print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True)
            raise typer.Exit(console.MISUSE) from None


app = typer.Typer(
    cls=_Group,
    name="mjfish",
    help="Shows what a swimming-fish simulation gets wrong, names the cause, and measures what knowing it gains.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        console.out.print(f"mjfish {version('mjfish')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Shows what a swimming-fish simulation gets wrong, names the cause, and measures what knowing it gains."""


@functools.cache
def application() -> typer.Typer:
    """Return the application with every command."""
    from mjfish.cli import check, compare, data, diagnose, export, identify, plan, simulate, view

    for module in (simulate, export, check, data, compare, identify, diagnose, plan, view):
        module.register(app)
    return app


def main() -> None:
    """Run the command line."""
    application()()
