"""Smoothed recordings: filters are what they say, and the problem's predictions and derivatives go through them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import signal

from mjfish.data import Trial
from mjfish.data.trial import Differentiator
from mjfish.estimation import Noise, Problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

#: Frames of a path between two samples, fine enough to be the truth.
FINER = 40
SIGMA = np.array([0.006, 0.006, 0.04])


def _trial(time: FloatArray, velocity: FloatArray) -> Trial:
    return Trial(name="tone", role=None, time=readonly(time), velocity=readonly(velocity))


def _tone(frequency: float, time: FloatArray) -> FloatArray:
    return np.asarray(np.sin(2.0 * np.pi * frequency * time)[:, None] * np.ones(3))


def test_what_central_differences_leave_of_a_tone() -> None:
    """sin(w dt) / (w dt)."""
    time, w = np.linspace(0.0, 7.98, 400), 2.0 * np.pi * 4.0
    tone = _tone(4.0, time)
    smooth = Differentiator(3, 2).of_trial(_trial(time, tone), tone)
    np.testing.assert_allclose(smooth[5:-5], np.sin(0.02 * w) / (0.02 * w) * tone[5:-5], atol=0.005)


def test_missing_samples_change_nothing_beside_them() -> None:
    time = np.linspace(0.0, 5.98, 300)
    tone, filtered = _tone(1.5, time), Differentiator(9, 2)
    kept = np.delete(np.arange(300), [100, 101, 180])
    whole = filtered.of_trial(_trial(time, tone), tone)
    torn = filtered.of_trial(_trial(time[kept], tone[kept]), tone[kept])
    np.testing.assert_allclose(torn, whole[kept], atol=0.002)


def test_positions_along_the_axes_of_the_tank_lose_more() -> None:
    """Differentiated there and turned by a heading that was not smoothed, sway lacks a share of the surge, too."""
    fine = np.asarray(0.02 / FINER * np.arange(400 * FINER), dtype=np.float64)
    velocity = np.column_stack([0.3 + 0.02 * np.sin(30.0 * fine), 0.1 * np.sin(15.0 * fine), 4.0 * np.cos(15.0 * fine)])
    yaw = 4.0 / 15.0 * np.sin(15.0 * fine)

    def turned(u: FloatArray, v: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v

    path = [np.cumsum(one) * 0.02 / FINER for one in (*turned(velocity[:, 0], velocity[:, 1], yaw), velocity[:, 2])]
    every = slice(None, None, FINER)
    vx, vy, rate = (signal.savgol_filter(one[every], 9, 2, deriv=1, delta=0.02) for one in path)
    recorded = np.column_stack([*turned(vx, vy, -yaw[every]), rate])
    trial, true = _trial(fine[every], recorded), velocity[every]
    inner = slice(10, -10)
    error = {
        how: float(np.std((how.of_trial(trial, true) - recorded)[inner, 1]))
        for how in (Differentiator(9, 2, turned=True), Differentiator(9, 2))
    }
    lost = float(np.std((true - recorded)[inner, 1]))
    assert error[Differentiator(9, 2, turned=True)] < 0.05 * lost
    assert error[Differentiator(9, 2)] > 0.2 * lost


def test_derivatives_and_samples_that_count_go_with_the_filter() -> None:
    fish = load_fish("pike")
    trials = generate(fish, ["v3-t2"], noise=SIGMA, duration=6.0, seed=1).trials
    plain = Problem(Model(fish), trials, Noise.white(SIGMA))
    smoothed = replace(plain, smoothing=Differentiator(9, 2))
    x, step = smoothed.start(), 1e-4
    slopes = smoothed.slopes(x).velocity[0]
    column = [p.name for p in smoothed.parameters].index("c_d.tail")
    up, down = x.copy(), x.copy()
    up[column] += step
    down[column] -= step
    difference = (smoothed.predictions(up)[0] - smoothed.predictions(down)[0])[smoothed.mask(0)] / (2.0 * step)
    np.testing.assert_allclose(slopes[:, :, column], difference, atol=1e-3 * np.abs(difference).max())
    assert np.abs(smoothed.predictions(x)[0] - plain.predictions(x)[0]).max() > 0.01
    left_out = trials[0].time[plain.mask(0) & ~smoothed.mask(0)]
    assert left_out.min() < 0.09
    assert left_out.max() > 5.9
    assert np.any(np.abs(left_out - trials[0].drive[1].start) < 0.12)
