"""Checks of the data, before physics is blamed: `run` before any fit, `after` with the nominal fit.

What they find is a `Finding`: its place, what was expected, a remedy, and the causes that such data cannot tell.
Nothing here raises for bad data that `mjfish.trial.load` accepts.
"""

from mjfish.checks.before import run
from mjfish.checks.compatibility import Compatibility, Estimated, compatibility
from mjfish.checks.finding import EVERYTHING, Checks, Finding, Severity
from mjfish.checks.later import after
from mjfish.checks.repeats import Repeats, noise_from_repeats

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
    "noise_from_repeats",
    "run",
]
