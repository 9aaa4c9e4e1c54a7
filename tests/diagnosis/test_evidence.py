"""The tests of a fitted model's residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_cases import draw

from mjfish.diagnosis.evidence import gather
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.model import Model
from mjfish.sized_cache import always


def test_a_cause_that_the_coefficients_hide_changes_no_p_value() -> None:
    """Its score and information are rounding errors; their quotient in the draws hides any other cause (p = 1)."""
    dataset = draw("com_offset", "weak", trials=4).dataset
    assert dataset.noise is not None
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)), jobs=1)
    fitted = fit(problem)
    found = {}
    for names in (("com_offset", "time_offset"), ("com_offset", "time_offset", "mass_error")):
        evidence = gather(problem, fitted, [find(name) for name in names])
        found[names] = evidence.directed_p(np.random.default_rng(0))
        assert (
            evidence.unidentifiable("mass_error")
            if "mass_error" in names
            else not evidence.unidentifiable("com_offset")
        )
    without, beside = found.values()
    assert without < 0.01
    assert beside < 0.01
    alone = gather(problem, fitted, [find("mass_error")])
    assert alone.directed_p(np.random.default_rng(0)) == 1.0


@pytest.mark.parametrize(("beyond", "hidden"), [(1e-2, False), (1e-4, True)])
def test_a_cause_is_identifiable_by_whatever_a_refit_leaves_of_it(beyond: float, hidden: bool) -> None:
    """A ten-thousandth of the energy may show in precise data; of a true gauge only rounding is left, 1e-8."""
    dataset = draw("com_offset", "weak", trials=4).dataset
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)), jobs=1)
    evidence = gather(problem, fit(problem, evaluations=1), [find("com_offset")])
    column = evidence.fit.jacobian.of_columns([0])
    column /= np.linalg.norm(column)
    other = evidence.signatures / np.linalg.norm(evidence.signatures)
    assert replace(evidence, raws=always(column + beyond * other)).unidentifiable("com_offset") is hidden
