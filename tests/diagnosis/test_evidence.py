"""The tests of a fitted model's residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_cases import draw

from mjfish.data import Trial
from mjfish.diagnosis.evidence import gather
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.problem import _Predicted
from mjfish.model import Model
from mjfish.numerics.sized_cache import always
from mjfish.parameters import Parameter


def test_a_cause_that_the_coefficients_hide_changes_no_p_value() -> None:
    """Its score and information are rounding errors; their quotient in the draws hides any other cause (p = 1)."""
    dataset = draw("com_offset", "weak", trials=4).dataset
    assert dataset.noise is not None
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    fitted = fit(problem)
    found = {}
    for names in (("com_offset", "time_offset"), ("com_offset", "time_offset", "mass_error")):
        evidence = gather(problem, fitted, [find(name) for name in names])
        found[names] = evidence.directed_p()
        assert (
            evidence.unidentifiable("mass_error")
            if "mass_error" in names
            else not evidence.unidentifiable("com_offset")
        )
    without, beside = found.values()
    assert without < 0.01
    assert beside < 0.01
    alone = gather(problem, fitted, [find("mass_error")])
    assert alone.directed_p() == 1.0


@pytest.mark.parametrize(("beyond", "hidden"), [(1e-2, False), (1e-4, True)])
def test_a_cause_is_identifiable_by_whatever_a_refit_leaves_of_it(beyond: float, hidden: bool) -> None:
    """A ten-thousandth of the energy may show in precise data; of a true gauge only rounding is left, 1e-8."""
    dataset = draw("com_offset", "weak", trials=4).dataset
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    evidence = gather(problem, fit(problem, evaluations=1), [find("com_offset")])
    column = evidence.fit.jacobian.of_columns([0])
    column /= np.linalg.norm(column)
    other = evidence.signatures / np.linalg.norm(evidence.signatures)
    assert replace(evidence, raws=always(column + beyond * other)).unidentifiable("com_offset") is hidden


def test_a_derivative_that_is_not_finite_leaves_its_cause_without_a_score(monkeypatch: pytest.MonkeyPatch) -> None:
    """At a rival's refit a derivative may diverge; the scores of the others stay as they are."""
    dataset = draw("com_offset", "weak", trials=4).dataset
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    fitted, names = fit(problem, evaluations=1), ["com_offset", "time_offset"]
    whole = gather(problem, fitted, [find(name) for name in names])
    honest = Problem._slopes

    def slopes(self: Problem, trial: Trial, here: dict[str, float], asked: list[Parameter]) -> _Predicted:
        found = honest(self, trial, here, asked)
        spoilt = np.array([p.name.startswith("com_offset.") for p in asked])
        found.velocity[-1, :, spoilt] = np.inf
        return found

    monkeypatch.setattr(Problem, "_slopes", slopes)
    broken = gather(problem, fitted, [find(name) for name in names])
    assert whole.scored("com_offset")
    assert not broken.scored("com_offset")
    assert np.isfinite(broken.score).all()
    assert broken.statistic("time_offset") == whole.statistic("time_offset")


def test_a_cause_that_is_not_smooth_at_its_null_raises_no_alarm_by_its_score() -> None:
    """A servo with a lag: the derivative by it shows plainly, and it is refitted instead of scored."""
    dataset = draw("servo_lag", "strong", trials=4).dataset
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    evidence = gather(problem, fit(problem), [find("servo_lag")])
    assert evidence.scored("servo_lag")
    assert evidence.statistic("servo_lag") > 100.0
    assert evidence.directed_p() == 1.0
