"""Measured swimming: trials, datasets of them, and the files they live in."""

from mjfish.data.read import load_dataset
from mjfish.data.sensor import Sensor
from mjfish.data.tables import read_table, write_table
from mjfish.data.trial import Clock, Dataset, Role, Tank, Trial
from mjfish.data.write import check_folder, save

__all__ = [
    "Clock",
    "Dataset",
    "Role",
    "Sensor",
    "Tank",
    "Trial",
    "check_folder",
    "load_dataset",
    "read_table",
    "save",
    "write_table",
]
