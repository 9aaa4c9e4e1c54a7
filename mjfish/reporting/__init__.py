"""What a reader gets of a result: a figure, an HTML page, a log of the swimming, a cell of a notebook.

`mjfish.files.result.Result` calls these functions. Each picks what fits the type of the result, and imports plotly,
jinja2 or rerun only then.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjfish.errors import InputError

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = ["figure", "notebook", "write_curves", "write_log", "write_report"]


def figure(result: Any) -> go.Figure:
    """Return the main figure of a result.

    Raises:
        InputError: this result has no figure.
    """
    from mjfish.reporting.html import pages, results

    return pages.Shown(results.figure(result).update_layout(showlegend=True))


def write_report(result: Any, path: str | Path) -> None:
    """Write a result as one HTML page that needs no network, whole or not at all.

    Raises:
        InputError: this result has no page, or the file cannot be written.
    """
    from mjfish.reporting.html import results

    results.write_report(result, Path(path))


def write_log(result: Any, path: str | Path) -> None:
    """Write the swimming in a result as a rerun log (``.rrd``), whole or not at all.

    Raises:
        InputError: this result has no log, or the file cannot be written.
    """
    from mjfish.reporting.log import results

    results.write_log(result, Path(path))


def write_curves(result: Any, folder: str | Path) -> tuple[Path, ...]:
    """Write the curves in a result as one CSV file each, all or none; return the files.

    Raises:
        InputError: this kind of result has no curves, or a file cannot be written.
    """
    from mjfish.diagnosis import DiagnosisData
    from mjfish.reporting import curves

    if not isinstance(result, DiagnosisData):
        raise InputError(f"{folder}: {type(result).__name__} has no curves to write; print it, or read its to_dict()")
    return curves.write_curves(result.mechanisms, Path(folder))


def notebook(result: Any) -> str:
    """Return a result as HTML for a notebook: its summary and its figure, which needs no network."""
    text = f"<pre>{escape(result.summary())}</pre>"
    try:
        drawn = figure(result)
    except InputError:  # a result without a figure, such as a fit that diverged, still has a summary
        return text
    return text + str(drawn._repr_mimebundle_()["text/html"])
