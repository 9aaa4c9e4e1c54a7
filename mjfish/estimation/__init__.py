"""Identification: bounded least squares on all fit trials at once, and what the data say about the estimates."""

from mjfish.estimation.fit import Fit, fit
from mjfish.estimation.identification import Identification, identify
from mjfish.estimation.nominal import residual_function
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import PREFIX, Part, Score, held_out_covariance_root, parts_of_trial, predict_held_out
from mjfish.estimation.settings import Settings
from mjfish.noise import Noise

__all__ = [
    "PREFIX",
    "Fit",
    "Identification",
    "Noise",
    "Part",
    "Problem",
    "Score",
    "Settings",
    "fit",
    "held_out_covariance_root",
    "identify",
    "parts_of_trial",
    "predict_held_out",
    "residual_function",
]
