"""Measured swimming: trials, datasets of them, and the files they live in."""

from mjfish.trial.read import load
from mjfish.trial.table import read_table, write_table
from mjfish.trial.types import Clock, Dataset, Role, Tank, Trial
from mjfish.trial.write import check_folder, save

__all__ = ["Clock", "Dataset", "Role", "Tank", "Trial", "check_folder", "load", "read_table", "save", "write_table"]
