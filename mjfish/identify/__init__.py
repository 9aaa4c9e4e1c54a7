"""Identification: bounded least squares on all fit trials at once."""

from mjfish.identify.fit import Fit, fit
from mjfish.identify.noise import Noise
from mjfish.identify.problem import Problem

__all__ = ["Fit", "Noise", "Problem", "fit"]
