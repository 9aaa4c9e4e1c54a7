"""Tests of the data, before physics is blamed: `inspect` before any fit, `inspect_fit` with the nominal fit.

What they find is a `Finding`: a stable code, its place, what was expected, a remedy, and the causes that such data
cannot show. Nothing here raises for bad data that `mjfish.load_dataset` accepts.
"""

from mjfish.inspection.after_fit import inspect_fit
from mjfish.inspection.before_fit import DataReport, Inspection, inspect, report_on
from mjfish.inspection.finding import EVERYTHING, Finding, Severity
from mjfish.inspection.kinematics import Compatibility, compatibility
from mjfish.inspection.repeats import Repeats, noise_from_repeats

__all__ = [
    "EVERYTHING",
    "Compatibility",
    "DataReport",
    "Finding",
    "Inspection",
    "Repeats",
    "Severity",
    "compatibility",
    "inspect",
    "inspect_fit",
    "noise_from_repeats",
    "report_on",
]
