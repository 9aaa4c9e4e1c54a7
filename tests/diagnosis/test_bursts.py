"""Noise that comes in bursts is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.implausible_noise import burstiness, coincidence, stand_out
from mjfish.fish import Fish
from mjfish.simulation.synthetic import generate

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
        bursty = burstiness(runs, widths, rng)
        assert abs(bursty) < 3.5
        assert not stand_out(bursty, coincidence(runs))
    jerked = [_jerked(run, range(20, 380, 60), 1.5) for run in quiet["white"]]
    assert stand_out(burstiness(jerked, widths, rng), coincidence(jerked))


def _swum(pike: Fish, size: float) -> Dataset:
    dataset = generate(pike, ["v1", "v3", "v5"], noise=SIGMA, duration=10.4, seed=11, held_out=[])
    trials = [
        replace(one, velocity=readonly(_jerked(one.velocity / SIGMA, range(40, 500, 77), size) * SIGMA))
        for one in dataset.trials
    ]
    return replace(dataset, trials=tuple(trials))


def test_a_diagnosis_says_when_the_bursts_were(pike: Fish) -> None:
    """Catches: jerks that pass for noise of another colour, and nothing wrong found."""
    assert diagnose(_swum(pike, 0.0)).verdict == "nothing_wrong"
    result = diagnose(_swum(pike, 2.5))
    assert result.verdict == "cannot_tell"
    finding = result.checks.blocks[0]
    for place in finding.place.split(", "):
        moment = float(place.split(" at ")[1].removesuffix(" s"))
        nearest = min(abs(moment - 0.02 * (start + WIDTH / 2)) for start in range(40, 500, 77))
        assert nearest < 0.15
