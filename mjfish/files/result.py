"""What every result can do: be read in a terminal and a notebook, be saved, be drawn."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from mjfish.errors.arguments import checked
from mjfish.files.plain_data import fields_of
from mjfish.files.writing import write_json


class Result:
    """Base of the results of `mjfish`'s functions; subclasses are frozen dataclasses with a `summary`.

    Pictures are made by `mjfish.reporting`, which is imported when one is asked for.
    """

    def summary(self) -> str:
        """Return what was found, in at most ten lines of text."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, the content of its JSON file."""
        return fields_of(self)

    @checked
    def save(self, path: str | Path) -> None:
        """Write the result as JSON, whole or not at all.

        Raises:
            InputError: the file cannot be written.
        """
        write_json(Path(path), self.to_dict())

    def plot(self) -> Any:
        """Return the result's main figure as a ``plotly.graph_objects.Figure``."""
        return reporting().figure(self)

    @checked
    def report(self, path: str | Path) -> None:
        """Write the result as one HTML page that needs no network.

        Raises:
            InputError: the file cannot be written, or this kind of result has no page.
        """
        reporting().write_report(self, Path(path))

    @checked
    def log(self, path: str | Path) -> None:
        """Write the result as a rerun log (``.rrd``), to be opened by ``mjfish view``.

        Raises:
            InputError: the file cannot be written, or this kind of result has no log.
        """
        reporting().write_log(self, Path(path))

    @checked
    def write_curves(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the curves in the result as one CSV file each, named ``MECHANISM-QUANTITY-GROUP.csv``.

        The columns are x, y, both ends of the 95 % band of y, the nominal y, and 1 or 0 for whether the runs have been
        at this x.

        Args:
            folder: to write to; made where it is not there, and not touched where there is no curve.

        Returns:
            The files.

        Raises:
            InputError: a file cannot be written, or this kind of result has no curves.
        """
        return tuple(reporting().write_curves(self, Path(folder)))

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.__repr__ = Result.__repr__  # type: ignore[method-assign]  # a dataclass would write one of its own

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return str(reporting().notebook(self))


def reporting() -> Any:
    """Return the package that draws results; it lies above them, so it is looked up when it is needed."""
    return importlib.import_module("mjfish.reporting")
