"""Identification: bounded least squares on all fit trials at once."""

from mjfish.identify.fit import Fit, fit
from mjfish.identify.noise import Noise
from mjfish.identify.problem import Problem
from mjfish.identify.report import Identification, identify
from mjfish.identify.score import Score, held_out_doubt, predict_held_out

__all__ = [
    "Fit",
    "Identification",
    "Noise",
    "Problem",
    "Score",
    "fit",
    "held_out_doubt",
    "identify",
    "predict_held_out",
]
