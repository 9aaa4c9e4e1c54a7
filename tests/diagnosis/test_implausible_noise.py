"""What was taken for noise and cannot be: too large and slow, or in bursts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hidden_cases import draw

from mjfish.data import Dataset, Trial
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.implausible_noise import burstiness, coincidence, stand_out, too_large
from mjfish.effects import find
from mjfish.estimation import Noise
from mjfish.fish import Fish
from mjfish.inspection import Repeats
from mjfish.noise.autoregressive import Autoregressive
from mjfish.noise.spectral import DifferentiationNoise
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.simulation.synthetic import generate

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
    assert "% of the measured rms" in found.found
    assert "swim one drive twice" in found.remedy


def test_noise_of_a_camera_does_not_block_the_verdict(trials: tuple[Trial, ...]) -> None:
    assert _asked(_Problem(trials, (0.04, 0.04, 0.04))) is None


def test_fast_residuals_do_not_count(trials: tuple[Trial, ...]) -> None:
    assert _asked(_Problem(trials, (0.12, 0.12, 0.12))) is not None
    assert _asked(_Problem(trials, (0.12, 0.12, 0.12), quick=True)) is None


def test_large_white_noise_is_accepted(trials: tuple[Trial, ...]) -> None:
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


WIDTH = 10
SIGMA = np.array([0.006, 0.006, 0.04])


def _jerked(run: FloatArray, starts: range, size: float) -> FloatArray:
    """Return a run with sway and yaw rate off by `size` sigma, together, for the length of a window now and then."""
    run = run.copy()
    for number, start in enumerate(starts):
        run[start : start + WIDTH, 1:] += size * (-1.0) ** number
    return run


@pytest.mark.parametrize("seed", range(4))
def test_bursts_are_told_from_tails_and_from_channels_that_go_together(seed: int) -> None:
    """In 40 draws of each the largest of all was 2.4; of jerks of one and a half sigma the smallest was 10.8."""
    rng = np.random.default_rng(seed)
    mix = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.7], [0.0, 0.0, 1.0]])
    quiet = {
        "white": [rng.standard_normal((400, 3)) for _ in range(4)],
        "heavy tails": [rng.standard_t(3.0, size=(400, 3)) for _ in range(4)],
        "together": [rng.standard_normal((400, 3)) @ mix for _ in range(4)],
        "runs of another level": [level * rng.standard_normal((400, 3)) for level in (1.0, 1.3, 0.8, 1.0)],
    }
    widths = [WIDTH] * 4
    for runs in quiet.values():
        bursty = burstiness(runs, widths)
        assert abs(bursty) < 3.5
        assert not stand_out(bursty, coincidence(runs))
    jerked = [_jerked(run, range(20, 380, 60), 1.5) for run in quiet["white"]]
    assert stand_out(burstiness(jerked, widths), coincidence(jerked))


def _swum(pike: Fish, size: float) -> Dataset:
    dataset = generate(pike, ["v1", "v3", "v5"], noise=SIGMA, duration=10.4, seed=11, held_out=[])
    trials = [
        replace(trial, velocity=readonly(_jerked(trial.velocity / SIGMA, range(40, 500, 77), size) * SIGMA))
        for trial in dataset.trials
    ]
    return replace(dataset, trials=tuple(trials))


@pytest.mark.slow
def test_a_diagnosis_states_the_times_of_bursts(pike: Fish) -> None:
    """Catches: jerks that pass for noise of another colour, and nothing wrong found."""
    few = {name: find(name) for name in ("servo_lag", "munk_moment", "velocity_scale")}
    assert diagnose(_swum(pike, 0.0), effects=few).verdict == "nothing_wrong"
    result = diagnose(_swum(pike, 2.5), effects=few)
    assert result.verdict == "cannot_tell"
    finding = result.checks.blocks[0]
    for place in finding.place.split(", "):
        moment = float(place.split(" at ")[1].removesuffix(" s"))
        nearest = min(abs(moment - 0.02 * (start + WIDTH / 2)) for start in range(40, 500, 77))
        assert nearest < 0.15
