"""The type of the fixture that runs a command line."""

from __future__ import annotations

from collections.abc import Callable

from typer.testing import Result

#: A command line and the exit code to expect in, what it printed out.
Run = Callable[..., Result]
