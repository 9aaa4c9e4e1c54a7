"""Synthetic datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjfish.data import Dataset, load_dataset, save
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.errors import InputError, MjfishError, UnknownNameError
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.01, 0.02, 0.05])


def _synthetic(fish: Fish, **changes: Any) -> Dataset:
    arguments: dict[str, Any] = {"mode_names": ["v1", "v3"], "noise": SIGMA, "duration": 2.0, "seed": 7, **changes}
    return generate(fish, arguments.pop("mode_names"), **arguments)


def _velocities(dataset: Dataset) -> list[bytes]:
    return [trial.velocity.tobytes() for trial in dataset.trials]


def test_the_same_seed_gives_the_same_data_and_another_seed_other_noise(pike: Fish) -> None:
    assert _velocities(_synthetic(pike)) == _velocities(_synthetic(pike))
    other = _velocities(_synthetic(pike, seed=8))
    assert all(a != b for a, b in zip(_velocities(_synthetic(pike)), other, strict=True))


def test_without_noise_it_is_the_truth_at_a_fine_step_and_states_no_noise(pike: Fish) -> None:
    truth = {"c_d.head": 2.0, "munk_moment.kappa": 0.5}
    for noise in (None, np.zeros(3)):
        dataset = _synthetic(pike, noise=noise, values=truth, effects=[find("munk_moment")])
        assert dataset.noise is None
        model = Model(pike, (find("munk_moment"),), step=0.001)
        for trial in dataset.trials:
            assert trial.velocity.tobytes() == model.predict(trial, model.values(truth)).velocity.tobytes()


def _noise(fish: Fish) -> FloatArray:
    noisy, clean = (
        _synthetic(fish, mode_names=["v1", "v5"], duration=10.4, rate=100.0, noise=sigma) for sigma in (SIGMA, None)
    )
    return np.concatenate([a.velocity - b.velocity for a, b in zip(noisy.trials, clean.trials, strict=True)])


def test_the_noise_is_white_of_the_stated_size_and_independent_between_channels_and_trials(pike: Fish) -> None:
    """Bounds are five standard errors of each statistic."""
    unit = _noise(pike) / SIGMA
    n = len(unit)
    assert n == 2 * 1041
    assert np.all(np.abs(unit.mean(axis=0)) < 5.0 / np.sqrt(n))
    assert np.all(np.abs(unit.std(axis=0) - 1.0) < 5.0 / np.sqrt(2 * n))
    within = np.corrcoef(unit.T)[np.triu_indices(3, 1)]
    lagged = [np.corrcoef(unit[:-lag, c], unit[lag:, c])[0, 1] for lag in (1, 2, 5) for c in range(3)]
    between = [np.corrcoef(unit[:1041, c], unit[1041:, c])[0, 1] for c in range(3)]
    assert np.all(np.abs([*within, *lagged, *between]) < 5.0 / np.sqrt(n / 2))


def test_a_mode_given_again_is_a_repeat_with_a_name_and_noise_of_its_own(pike: Fish) -> None:
    dataset = _synthetic(pike, mode_names=["v1", "v3", "v1", "v1"])
    assert [trial.name for trial in dataset.trials] == ["v1", "v3", "v1.2", "v1.3"]
    first, _, second, third = dataset.trials
    assert first.drive == second.drive == third.drive == modes.drive("v1")
    assert len({first.velocity.tobytes(), second.velocity.tobytes(), third.velocity.tobytes()}) == 3
    clean = _synthetic(pike, mode_names=["v1", "v1"], noise=None)
    assert clean.trials[0].velocity.tobytes() == clean.trials[1].velocity.tobytes()


def test_held_out_trials_have_that_role_and_all_others_are_fitted(pike: Fish) -> None:
    dataset = _synthetic(pike, mode_names=["v1", "v3", "v1"], held_out=["v1.2"])
    assert [trial.role for trial in dataset.trials] == ["fit", "fit", "held_out"]
    assert [trial.role for trial in _synthetic(pike).trials] == [None, None]
    assert _velocities(_synthetic(pike, held_out=["v3"])) == _velocities(_synthetic(pike))


@pytest.mark.parametrize(("rate", "duration", "samples"), [(50.0, 2.0, 101), (30.0, 1.0, 31), (60.0, 0.99, 60)])
def test_samples_are_at_the_rate_from_0_to_the_last_before_the_end(
    pike: Fish, rate: float, duration: float, samples: int
) -> None:
    trial = _synthetic(pike, rate=rate, duration=duration, mode_names=["v1"]).trials[0]
    np.testing.assert_array_equal(trial.time, np.arange(samples) / rate)
    assert trial.velocity.shape == (samples, 3)


def test_the_dataset_does_not_give_the_truth_away(pike: Fish) -> None:
    dataset = _synthetic(pike, values={"c_d.head": 2.0, "servo_lag.time_constant": 0.03}, effects=[find("servo_lag")])
    assert dataset.fish is pike
    assert dataset.trials[0].drive == modes.drive("v1")
    assert dataset.trials[0].joint_angle is None


@pytest.mark.parametrize("name", ["time_offset", "servo_lag", "ambient_current", "tail_compliance"])
def test_a_generated_effect_is_in_the_data(pike: Fish, name: str) -> None:
    effect = find(name)
    values = {p.name: p.default + 3.0 * p.scale for p in effect.parameters}
    with_it, without = (
        _synthetic(pike, noise=None, effects=effects, values=given).trials[0].velocity
        for effects, given in (([effect], values), ([], {}))
    )
    assert np.max(np.abs(with_it - without)) > 0.01


def test_what_is_generated_can_be_saved_and_read_back(pike: Fish, tmp_path: Path) -> None:
    dataset = _synthetic(pike, held_out=["v3"], name="pool")
    save(dataset, tmp_path / "pool")
    back = load_dataset(tmp_path / "pool")
    assert _velocities(back) == _velocities(dataset)
    assert [trial.role for trial in back.trials] == ["fit", "held_out"]
    np.testing.assert_array_equal(back.noise, SIGMA)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "two sigmas": ({"noise": np.array([0.01, 0.01])}, r"noise is \[0.01, 0.01\], expected three numbers"),
    "negative sigma": ({"noise": np.array([0.01, -0.01, 0.05])}, "expected three numbers of at least 0"),
    "nan sigma": ({"noise": np.array([0.01, np.nan, 0.05])}, "expected three numbers of at least 0"),
    "one sigma zero": ({"noise": np.array([0.01, 0.0, 0.05])}, "give every channel some, or none any"),
    "rate": ({"rate": 0.0}, "duration 2 s at 0 Hz: expected more than 0 and at most 10000 s, more than 0 Hz"),
    "endless": ({"duration": np.inf}, "duration inf s at 50 Hz: expected .* and at most 1e.07 samples; correct it"),
    "not a number": ({"duration": np.nan}, "duration nan s at 50 Hz: expected more than 0"),
    "seed": ({"seed": -1}, "seed is -1, expected 0 or more"),
    "mode": ({"mode_names": ["v2"]}, "unknown mode 'v2'; known: v1, "),
    "mode too short": (
        {"mode_names": ["v1", "v1-t2"]},
        "mode 'v1-t2' changes at 5.2 s, after the end of a trial of 2 s",
    ),
    "held out": ({"held_out": ["v7"]}, "unknown trial 'v7'; known: v1, v3"),
    "coefficient": ({"values": {"c_d.fin": 1.0}}, "unknown parameter 'c_d.fin'"),
    "effect": ({"values": {"servo_lagg.time_constant": 0.1}}, "unknown parameter 'servo_lagg.time_constant'"),
    "bounds": ({"values": {"c_d.head": 9.0}}, r"c_d.head: value 9 - is outside its bounds \[0.1, 4\]"),
    "effect twice": ({"effects": [find("servo_lag")] * 2}, "one is there twice"),
}


@pytest.mark.parametrize(("changes", "complaint"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_generated_is_refused(pike: Fish, changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(MjfishError, match=complaint) as caught:
        _synthetic(pike, **changes)
    assert isinstance(caught.value, (ValueError, UnknownNameError))


def test_a_truth_that_diverges_is_refused_with_trial_time_and_parameters(pike: Fish) -> None:
    wide = {p.name: p.rebound(high=1e9) for p in pike.parameters if p.name == "c_d.tail"}
    with pytest.raises(InputError, match=r"v1: the simulated fish diverged at 0.* with c_m.head = .*c_d.tail = 1e\+08"):
        _synthetic(pike.with_coefficients(wide), values={"c_d.tail": 1e8})
