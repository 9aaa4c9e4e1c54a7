"""A wave whose clock is not the record's: its frequency and phase are found with the coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset, Sensor, Trial
from mjfish.drive.wave import Wave
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.clocks import aligned
from mjfish.fish import load_fish
from mjfish.model import Model

FISH = load_fish("eth_tendon")
TRUE = Wave(0.92, (0.24, 0.21, 0.16, 0.10, 0.18), (0.3, -0.1, -0.5, -0.9, -1.3), (0.03,) * 5, free=True)
START = np.array([0.08, 0.02, -0.3])
SIGMA = np.array([0.002, 0.004, 0.03])


def _trial(wave: Wave, seed: int | None = 0) -> Trial:
    """Return a swim driven by the true wave, said to be driven by another."""
    time = np.arange(151) / 30
    blank = Trial("run", None, time, np.zeros((151, 3)), wave=TRUE)
    model = Model(FISH)
    velocity = model.predict(blank, model.values(), velocity=START).velocity
    if seed is not None:
        velocity = velocity + np.random.default_rng(seed).normal(0.0, SIGMA, velocity.shape)
    return replace(blank, velocity=velocity, wave=wave)


def _problem(trial: Trial) -> Problem:
    return Problem(Model(FISH), (trial,), Noise.white(SIGMA), fixed=FISH.values)


@pytest.mark.parametrize("lag", [False, True], ids=["plain", "through a servo"])
def test_derivatives_by_frequency_and_phase_are_exact(lag: bool) -> None:
    """The frequency turns about the middle of the record: about its start, the derivative is another."""
    model = Model(FISH, (find("servo_lag"),) if lag else ())
    values = {"servo_lag.time_constant": 0.03} if lag else {}
    problem = replace(_problem(_trial(TRUE, None)), model=model, fixed={**FISH.values, **values})
    x = problem.start()
    (slopes,) = problem.slopes(x).velocity
    names = [p.name for p in problem.parameters]
    for name, step in (("run:wave.frequency", 1e-4), ("run:wave.phase", 1e-4)):
        k = names.index(name)
        by = np.eye(len(x))[k] * step
        (ahead,), (back,) = problem.predictions(x + by), problem.predictions(x - by)
        np.testing.assert_allclose(
            slopes[:, :, k], ((ahead - back) / (2 * step))[problem.mask(0)], atol=2e-5, rtol=1e-5
        )


def test_frequency_and_phase_are_found_from_a_wrong_clock() -> None:
    """1 % off in frequency and 2.5 rad in phase: the alignment brings the phase near, the fit to within its sigma."""
    said = replace(TRUE, frequency=0.929, phase=tuple(p - 2.5 for p in TRUE.phase))
    dataset = aligned(Dataset("one", FISH, (_trial(said),)))
    problem = _problem(dataset.trials[0])
    found = fit(problem, problem.start())
    assert found.status == "converged", found
    wave = dataset.trials[0].wave
    assert wave is not None
    moved = (
        dataset.trials[0]
        .waved(found.values["run:wave.frequency"] - wave.frequency, found.values["run:wave.phase"])
        .wave
    )
    assert moved is not None
    assert moved.frequency == pytest.approx(TRUE.frequency, abs=5e-4)
    middle = 2 * np.pi * (moved.frequency - TRUE.frequency) * 2.5 + np.subtract(moved.phase, TRUE.phase)
    np.testing.assert_allclose(np.angle(np.exp(1j * middle)), 0.0, atol=0.03)


def test_the_phase_is_found_from_places_and_headings() -> None:
    """Of a film without velocities: the smoothed path swings with the beat."""
    time = np.arange(151) / 30
    blank = Trial("run", None, time, np.full((151, 3), np.nan), wave=TRUE)
    sensors = (Sensor("p", "position", time, np.zeros((151, 2))), Sensor("h", "heading", time, np.zeros((151, 1))))
    model = Model(FISH)
    read = model.predict(
        replace(blank, sensors=sensors), model.values(), velocity=START, pose=np.array([0.3, 0.1, 2.0])
    )
    rng = np.random.default_rng(3)
    seen = tuple(
        replace(sensor, values=values + rng.normal(0.0, 1e-3, values.shape))
        for sensor, values in zip(sensors, read.sensors, strict=True)
    )
    said = replace(TRUE, phase=tuple(p - 2.5 for p in TRUE.phase))
    (found,) = aligned(Dataset("one", FISH, (replace(blank, wave=said, sensors=seen),))).trials
    assert found.wave is not None
    turned = np.angle(np.exp(1j * (np.array(found.wave.phase) - np.array(TRUE.phase))))
    assert np.max(np.abs(turned)) < 2.0 * np.pi / 16


def test_a_wave_with_the_records_clock_has_nothing_free() -> None:
    trial = _trial(replace(TRUE, free=False))
    assert not any("wave" in p.name for p in _problem(trial).parameters)
    dataset = Dataset("one", FISH, (trial,))
    assert aligned(dataset) is dataset
