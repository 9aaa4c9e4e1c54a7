"""The guesser by sparse regression: it names a cause, from derivatives by all parameters, those of single runs too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset
from mjfish.design import FittedModels
from mjfish.effects import catalogue
from studies.battery.sparse_regression import _whole, sparsest

SIGMA = np.array([0.002, 0.002, 0.01])


@pytest.fixture(scope="module")
def swum() -> Dataset:
    return mjfish.generate("pike", ["v1", "v5"], duration=2.0, noise=SIGMA, seed=1)


def test_it_names_a_cause_of_the_catalogue(swum: Dataset) -> None:
    assert sparsest(swum) in catalogue()


def test_derivatives_by_parameters_of_single_runs_stand_in_their_columns(swum: Dataset) -> None:
    problem = FittedModels.undiagnosed(replace(swum, clock="free"), {}).problem
    slopes = problem.slopes(problem.start())
    assert any(map(len, slopes.per_trial))
    whole = problem.whiten(_whole(problem, problem.start()))
    assert np.allclose(whole, problem.velocity_rows(slopes).dense(), rtol=1e-9, atol=1e-9 * np.abs(whole).max())
