"""``mjfish view``: open a log in the rerun viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(view)


def view(file: Annotated[Path, typer.Argument(help="A .rrd file.")]) -> None:
    """Open a log in the rerun viewer."""
    from mjfish.reporting.log import view as open_log

    open_log(file)
