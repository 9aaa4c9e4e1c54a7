"""Checks of the data, before physics is blamed: `inspect` before any fit, `after` with the nominal fit.

What they find is a `Finding`: its place, what was expected, a remedy, and the causes that such data cannot tell.
Nothing here raises for bad data that `mjfish.data.load_dataset` accepts.
"""

from mjfish.inspection.before import inspect
from mjfish.inspection.compatibility import Compatibility, Estimated, compatibility
from mjfish.inspection.finding import EVERYTHING, Checks, Finding, Severity
from mjfish.inspection.later import after
from mjfish.inspection.repeats import Repeats, noise_from_repeats

__all__ = [
    "EVERYTHING",
    "Checks",
    "Compatibility",
    "Estimated",
    "Finding",
    "Repeats",
    "Severity",
    "after",
    "compatibility",
    "inspect",
    "noise_from_repeats",
]
