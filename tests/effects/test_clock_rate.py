"""Rate of the clock: the same run at another pace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from recovery import found_again

from mjfish.data import Dataset, Trial
from mjfish.drive.wave import Wave
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray

RATE = find("clock_rate")
WAVE = Wave(1.3, (0.3, 0.35, 0.4, 0.45), (0.0, -0.7, -1.4, -2.1), (0.0, 0.0, 0.1, 0.0), ramp=1.0)


def _predict(fish: Fish, trial: Trial, error: float) -> FloatArray:
    model = Model(fish, (RATE,))
    return model.predict(trial, model.values({"clock_rate.error": error})).velocity


def _driven(straight: Trial, wave: Wave) -> Trial:
    return replace(straight, drive=(), wave=wave)


def test_a_slow_camera_is_a_fast_drive(pike: Fish, straight: Trial) -> None:
    """Force and inertia are of second order in the rates: a wave that is faster, its ramp too, is another clock."""
    error = 0.03
    faster = replace(WAVE, frequency=WAVE.frequency * (1.0 + error), ramp=WAVE.ramp / (1.0 + error))
    slow, fast = _predict(pike, _driven(straight, WAVE), error), _predict(pike, _driven(straight, faster), 0.0)
    nominal = _predict(pike, _driven(straight, WAVE), 0.0)
    np.testing.assert_allclose(slow, fast, rtol=0.0, atol=2e-6)
    assert np.abs(nominal - fast).max() > 0.02


def test_a_hidden_rate_is_found_again(pike: Fish) -> None:
    sizes = {"error": -0.004}
    found = found_again(pike, RATE, sizes)
    assert found.sigma["clock_rate.error"] < 0.001


def test_it_is_no_candidate_where_the_frequency_of_every_run_is_fitted(pike: Fish, straight: Trial) -> None:
    free, known = (_driven(straight, replace(WAVE, free=free)) for free in (True, False))
    assert "fitted already" in RATE.not_applicable(Dataset("free", pike, (free,)))
    assert RATE.not_applicable(Dataset("known", pike, (free, replace(known, name="other")))) == ""
