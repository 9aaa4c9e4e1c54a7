"""Identification: bounded least squares on all fit trials at once."""

from mjfish.estimation.fit import Fit, fit
from mjfish.estimation.noise import Noise
from mjfish.estimation.problem import Problem
from mjfish.estimation.report import Identification, identify
from mjfish.estimation.score import Score, held_out_doubt, predict_held_out

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
