"""Repeats give the noise of the data, whatever the model; where they differ by more, it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_data import SIGMA, good, only, remarked, spoiled, velocity
from scipy import signal

from mjfish.data import Dataset, Trial
from mjfish.inspection import inspect, noise_from_repeats
from mjfish.numerics.arrays import FloatArray, readonly


def _repeated(phi: float, count: int = 4) -> Dataset:
    """Repeat v1 with autoregressive noise on top of the generated white one."""
    rng = np.random.default_rng(8)
    base = good(("v1", "v3", *("v1",) * (count - 1)))

    def coloured(values: FloatArray) -> FloatArray:
        white = rng.standard_normal((len(values) + 200, 3))
        return values + SIGMA * signal.lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], white, axis=0)[200:]

    return spoiled(velocity(coloured), dataset=base)


@pytest.mark.parametrize("count", [2, 4])
def test_sigma_and_autocorrelation_come_back(count: int) -> None:
    """White plus AR(1) of 0.9, one sigma each. Catches sqrt(2), sqrt(R / (R - 1)), a mean taken from each run."""
    found = noise_from_repeats(_repeated(0.9, count))
    assert found is not None
    assert found.sigma == pytest.approx(np.sqrt(2.0) * SIGMA, rel=0.25 if count == 2 else 0.12)
    assert found.autocorrelation[:, 1] == pytest.approx(0.45, abs=0.15)
    assert found.noise.order > 0


def test_without_repeats_there_is_none() -> None:
    """Catches runs of like drives that are taken for repeats."""
    assert noise_from_repeats(good(("v1", "v3", "v1-t1"))) is None


def test_gaps_in_one_repeat_leave_the_rest() -> None:
    """Catches rows that are paired by their number, not by their time."""

    def lost(trial: Trial) -> Trial:
        keep = np.ones(len(trial.time), dtype=bool)
        keep[100:140] = False
        return replace(trial, time=readonly(trial.time[keep]), velocity=readonly(trial.velocity[keep]), gaps=True)

    found = noise_from_repeats(spoiled(lost, "v1"))
    assert found is not None
    assert found.sigma == pytest.approx(SIGMA, rel=0.2)


@pytest.mark.parametrize("factor", [1.1, 0.97])
def test_repeats_that_differ_at_the_beat_are_suspect(factor: float) -> None:
    """One of them is scaled. Catches a noise estimate that swallows the difference."""
    found = only(inspect(spoiled(velocity(lambda v: v * factor), "v1.2")), "repeats")
    assert found.trials == ("v1", "v1.2")
    assert remarked(inspect(good()), "repeats")


def test_a_clock_that_is_free_may_differ_between_repeats() -> None:
    """A sample apart. Catches a clock offset, known to be unknown, that is called noise."""

    def late(trial: Trial) -> Trial:
        return replace(trial, time=trial.time[:-1], velocity=readonly(trial.velocity[1:]))

    apart = spoiled(late, "v1.2")
    assert only(inspect(apart), "repeats")
    free = noise_from_repeats(replace(apart, clock="free"))
    assert free is not None
    assert free.sigma[1] < 4.0 * SIGMA[1]
