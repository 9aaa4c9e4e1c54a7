"""Importer of the marker files of srl-ethz/fishsim: steady swimming of a six-link tendon-driven fish robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mjfish.importers import markers
from mjfish.importers.layouts import layout
from mjfish.importers.report import ImportReport
from mjfish.trial import Dataset


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Import marker files as they are in the folder Data/Markers of the repository, see `mjfish.importers.markers`."""
    return markers.import_files(files, held_out, mapping or layout("fishsim"), importer="fishsim")
