"""A problem on the runs of a menu, and slopes by what a refit moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.design.menu import Run
from mjfish.estimation import Problem
from mjfish.parameter import Parameter


def on_menu(problem: Problem, runs: Sequence[Run]) -> Problem:
    """Return the problem with the runs of a menu for its trials, all of their samples counted."""
    return replace(problem, trials=tuple(run.trial for run in runs), windows=None, ends=0)


def slopes(problem: Problem, x: FloatArray, moved: Sequence[Parameter]) -> list[FloatArray]:
    """Return, per trial, the derivative (n_i, 3, p) of the counted samples by the parameters over their scales."""
    return [block * scales(moved) for block in problem.sensitivities(x, only=[p.name for p in moved])]


def scales(parameters: Sequence[Parameter]) -> FloatArray:
    """Return the scales (p,) of parameters."""
    return np.array([p.scale for p in parameters])
