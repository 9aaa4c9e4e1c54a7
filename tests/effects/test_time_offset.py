"""Clock offset: the same run, read at other times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset, Trial
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

OFFSET = find("time_offset")


def _predict(fish: Fish, trial: Trial, offset: float) -> FloatArray:
    model = Model(fish, (OFFSET,))
    return model.predict(trial, model.values({"time_offset.offset": offset})).velocity


def _every_fifth_ms(trial: Trial, duration: float) -> Trial:
    time = np.arange(round(duration * 200) + 1) / 200
    return replace(trial, time=readonly(time), velocity=readonly(np.zeros((len(time), 3))))


def test_what_is_recorded_at_t_happened_at_t_plus_offset(pike: Fish, turning: Trial) -> None:
    """Read off a run sampled four times as often. Catches an offset of the wrong sign, and one of the step only."""
    dense = Model(pike).predict(_every_fifth_ms(turning, 3.25), Model(pike).values()).velocity
    for shift in (7, 30, -7, -30):
        recorded = _predict(pike, turning, shift / 200)
        at = np.arange(len(turning.time)) * 4 + shift
        np.testing.assert_allclose(recorded[at >= 0], dense[at[at >= 0]], rtol=0.0, atol=1e-11)


def test_before_the_drive_starts_the_fish_rests(pike: Fish, straight: Trial) -> None:
    recorded = _predict(pike, straight, -0.1)
    assert not np.any(recorded[straight.time < 0.1 - 1e-9])
    assert np.all(np.any(recorded[straight.time > 0.1 + 1e-9] != 0.0, axis=1))


@pytest.mark.parametrize("offset", [OFFSET.parameters[0].low, OFFSET.parameters[0].high])
def test_the_fish_swims_on_behind_the_last_sample_as_far_as_the_offset_may_reach(
    pike: Fish, straight: Trial, offset: float
) -> None:
    """Catches a run that ends before the largest offset, whose last state would be read over and over."""
    longer = Model(pike).predict(_every_fifth_ms(straight, 3.25), Model(pike).values()).velocity
    recorded = _predict(pike, straight, offset)
    np.testing.assert_allclose(recorded[-1], longer[round((3.0 + offset) * 200)], rtol=0.0, atol=1e-6)
    assert np.all(np.ptp(recorded[-8:], axis=0) > 1e-4)


def test_nuisance_offset_and_effect_add_up(pike: Fish, straight: Trial) -> None:
    model = Model(pike, (OFFSET,))
    both = model.predict(straight, model.values({"time_offset.offset": 0.03}), offset=0.05).velocity
    np.testing.assert_allclose(both, _predict(pike, straight, 0.08), rtol=0.0, atol=1e-12)


def test_it_is_no_candidate_where_every_trial_has_an_offset_of_its_own(pike: Fish, straight: Trial) -> None:
    assert "clock = 'free'" in OFFSET.not_applicable(Dataset("free", pike, (straight,), clock="free"))
    assert OFFSET.not_applicable(Dataset("synchronised", pike, (straight,))) == ""
