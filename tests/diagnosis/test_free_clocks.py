"""A fish driven by a wave with a clock of its own, said half a turn wrong: the diagnosis finds the clock first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset, Trial
from mjfish.diagnosis import diagnose
from mjfish.drive.wave import Wave
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

FISH = load_fish("eth_tendon")
SIGMA = np.array([0.002, 0.004, 0.03])
START = np.array([0.08, 0.02, -0.3])
HIDDEN = {"velocity_scale.error": 0.2}
KNOWN = ("velocity_scale", "frame_misalignment", "linear_drag")


def _dataset(seed: int, turned: float) -> Dataset:
    """Return two fitted runs and one held out, measured by a camera whose scale is off."""
    rng = np.random.default_rng(seed)
    model = Model(FISH, (find("velocity_scale"),))
    trials = []
    for name, frequency in (("slow", 0.6), ("middle", 0.9), ("fast", 1.2)):
        wave = Wave(frequency, (0.24, 0.21, 0.16, 0.10, 0.18), (0.3, -0.1, -0.5, -0.9, -1.3), (0.03,) * 5, free=True)
        time = np.arange(241) / 30
        blank = Trial(name, None, time, readonly(np.zeros((241, 3))), wave=wave)
        swum = model.predict(blank, {**model.values(), **HIDDEN}, velocity=START).velocity
        noisy = readonly(swum + rng.normal(0.0, SIGMA, swum.shape))
        said = replace(wave, phase=tuple(phase + turned for phase in wave.phase))
        trials.append(replace(blank, velocity=noisy, wave=said))
    return Dataset("free clocks", FISH, tuple(trials), noise=(0.002, 0.004, 0.03))


@pytest.mark.slow
def test_a_clock_half_a_turn_off_does_not_mislead() -> None:
    """Without aligning the clocks first, the fit stops at a wrong turn and the misfit is blamed on something else."""
    result = diagnose(_dataset(3, turned=2.6), effects={name: find(name) for name in KNOWN}, jobs=1)
    assert [cause.name for cause in result.causes] == ["velocity_scale"], result.message
    found = result.extended["velocity_scale.error"]
    assert found.low < HIDDEN["velocity_scale.error"] < found.high
