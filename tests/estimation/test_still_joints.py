"""Residual tests where a joint, or all of them, do not move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset
from mjfish.drive.wave import Wave
from mjfish.estimation import identify
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate


def _waved(pike: Fish, amplitude: tuple[float, ...]) -> Dataset:
    """Return three noisy runs of waves with these amplitudes [rad]."""
    rng, model, trials = np.random.default_rng(0), Model(pike), []
    for k, trial in enumerate(generate(pike, ["v1", "v3", "v5"], duration=6.0).trials):
        driven = replace(trial, drive=(), wave=Wave(1.5 + 0.4 * k, amplitude, (0.0, -0.8, -1.6, -2.4), (0.0,) * 4, 0.5))
        velocity = model.predict(driven, model.values()).velocity
        noise = rng.normal(size=velocity.shape) * [0.01, 0.01, 0.05]
        trials.append(replace(driven, velocity=readonly(velocity + noise)))
    return Dataset("waved", pike, tuple(trials))


@pytest.mark.parametrize(
    ("amplitude", "tested"),
    [((0.2, 0.2, 0.2, 0.0), True), ((0.0, 0.0, 0.0, 0.3), True), ((0.0,) * 4, False)],
    ids=["last-still", "last-moves", "all-still"],
)
def test_a_still_joint_is_no_input(pike: Fish, amplitude: tuple[float, ...], tested: bool) -> None:
    """Catches a traceback where the last joint is still, and a test of independence without an input."""
    result = identify(_waved(pike, amplitude), starts=1)
    assert result.fit.status == "converged"
    assert result.assessment is not None
    p_values = [one.p_value for one in result.assessment.residual_tests.independence]
    assert np.isfinite(p_values).all() == tested
    assert len(result.summary().splitlines()) <= 10
