"""Noise that is too large to be one."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from planted_cases import draw

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.diagnosis.implausible_noise import too_large
from mjfish.estimation import Noise
from mjfish.inspection import Repeats
from mjfish.noise.autoregressive import Autoregressive
from mjfish.noise.differentiation import DifferentiationNoise

SLOW = Autoregressive(readonly(np.full(3, 0.01)), readonly(np.full((3, 1), 0.9)))
FIT: Any = SimpleNamespace(x=None)


@dataclass
class _Problem:
    """A problem whose residual is a share of each channel of its one trial, both rms."""

    trials: tuple[Trial, ...]
    share: tuple[float, float, float]
    noise: Noise = field(default_factory=lambda: SLOW)
    quick: bool = False

    def mask(self, _index: int) -> BoolArray:
        return np.ones(len(self.trials[0].time), dtype=bool)

    def raw(self, _x: FloatArray) -> list[FloatArray]:
        velocity = self.trials[0].velocity
        half = np.arange(len(velocity)) < len(velocity) // 2
        sign = (
            np.where(half, 1.0, -1.0) if not self.quick else np.random.default_rng(1).choice([1.0, -1.0], len(velocity))
        )
        return [sign[:, None] * np.array(self.share) * np.sqrt(np.mean(velocity**2, axis=0))]


@pytest.fixture(scope="module")
def trials() -> tuple[Trial, ...]:
    return draw("time_offset", "middling", trials=2).dataset.trials[:1]


def _asked(problem: Any, repeats: Any = None) -> Any:
    return too_large(problem, FIT, repeats)


def test_slow_noise_as_large_as_a_part_of_the_motion_blocks_the_verdict(trials: tuple[Trial, ...]) -> None:
    found = _asked(_Problem(trials, (0.05, 0.3, 0.2)))
    assert (found.severity, found.place, found.channels) == ("blocks", "sway", ("sway", "yaw_rate"))
    assert "% of all of it" in found.found
    assert "swim one drive twice" in found.remedy


def test_noise_of_a_camera_does_not(trials: tuple[Trial, ...]) -> None:
    assert _asked(_Problem(trials, (0.04, 0.04, 0.04))) is None


def test_what_is_quick_of_it_does_not_count(trials: tuple[Trial, ...]) -> None:
    assert _asked(_Problem(trials, (0.12, 0.12, 0.12))) is not None
    assert _asked(_Problem(trials, (0.12, 0.12, 0.12), quick=True)) is None


def test_large_noise_without_a_colour_is_believed(trials: tuple[Trial, ...]) -> None:
    """A misfit is slow: it does not pass for white noise, nor for that of differentiated positions."""
    white = Noise.white(np.full(3, 0.01))
    rough = DifferentiationNoise(readonly(np.full(3, 0.01)), readonly(np.zeros((3, 0))))
    for noise in (white, rough):
        assert _asked(_Problem(trials, (0.5, 0.5, 0.5), noise)) is None


def test_noise_that_differs_between_repeats_is_noise(trials: tuple[Trial, ...]) -> None:
    problem = _Problem(trials, (0.3, 0.05, 0.05))
    error = 0.3 * float(np.sqrt(np.mean(trials[0].velocity[:, 0] ** 2)))

    def repeats(share: float) -> Repeats:
        sigma = readonly(np.array([share * error, 1.0, 1.0]))
        return Repeats((), (), SLOW, sigma, readonly(np.ones((3, 1))), 10.0, ())  # type: ignore[arg-type]

    assert _asked(problem, repeats(0.9)) is None
    assert _asked(problem, repeats(0.4)).channels == ("surge",)
