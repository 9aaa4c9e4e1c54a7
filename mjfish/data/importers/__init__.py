"""Importers: measured files of some laboratory in, a dataset and a report of what was done to them out."""

from mjfish.data.importers.registry import IMPORTERS, Importer, import_files
from mjfish.data.importers.trials import HEADERS, Cut, FileReport, ImportReport

__all__ = ["HEADERS", "IMPORTERS", "Cut", "FileReport", "ImportReport", "Importer", "import_files"]
