"""Identification: bounded least squares on all fit trials at once."""

from mjfish.estimation.agreement import Part, parts_of_trial
from mjfish.estimation.callable import residual_function
from mjfish.estimation.fit import Fit, fit
from mjfish.estimation.noise import Noise
from mjfish.estimation.problem import Problem
from mjfish.estimation.report import Identification, identify
from mjfish.estimation.score import PREFIX, Score, held_out_doubt, predict_held_out
from mjfish.estimation.settings import Settings
from mjfish.estimation.table_iv import PAPER

__all__ = [
    "PAPER",
    "PREFIX",
    "Fit",
    "Identification",
    "Noise",
    "Part",
    "Problem",
    "Score",
    "Settings",
    "fit",
    "held_out_doubt",
    "identify",
    "parts_of_trial",
    "predict_held_out",
    "residual_function",
]
