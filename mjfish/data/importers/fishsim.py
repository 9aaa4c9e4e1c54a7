"""Importer of the marker files of srl-ethz/fishsim: steady swimming of a six-link tendon-driven fish robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mjfish.data import Dataset
from mjfish.data.importers import markers
from mjfish.data.importers.layouts import layout
from mjfish.data.importers.report import ImportReport


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Import marker files of the folder Data/Markers of the repository, see `mjfish.data.importers.markers`."""
    return markers.import_files(files, held_out, mapping or layout("fishsim"), importer="fishsim")
