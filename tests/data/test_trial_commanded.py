"""Recorded commands: servos stand between them and the joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset, save
from mjfish.data.trial import Hold
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.estimation import fit
from mjfish.estimation.nominal import nominal_problem
from mjfish.model import requested_motion
from mjfish.noise import Noise
from mjfish.numerics.arrays import readonly

SIGMA = np.array([0.006, 0.006, 0.04])


def commanded(lag: float) -> Dataset:
    """Return a run of the pike whose servos lag behind a command that is recorded, and held, 100 times a second."""
    pool = mjfish.generate("pike", ["v3"], duration=4.0)
    time = np.arange(0.0, 4.0, 0.01)
    told = (
        0.4
        * np.sin(2.0 * np.pi * 2.0 * time[:, None] - np.array([0.0, 0.8, 1.6, 2.4]))
        * np.array([0.3, 0.5, 0.7, 1.0])
    )
    trial = replace(
        pool.trials[0], role="fit", drive=(), time=readonly(time), velocity=readonly(np.zeros((len(time), 3))),
        joint_angle=readonly(told), commanded=True,
    )  # fmt: skip
    model = mjfish.Model(pool.fish).extended(find("servo_lag"))
    values = model.values({"servo_lag.time_constant": lag})
    swum = model.predict(trial, values, velocity=np.array([0.3, 0.0, 0.0]))
    return replace(pool, trials=(replace(trial, velocity=readonly(swum.velocity)),))


def test_a_lag_behind_recorded_commands_is_found() -> None:
    dataset = commanded(0.04)
    problem = nominal_problem(dataset, dataset.trials, Noise.white(SIGMA))
    lagging = replace(problem, model=problem.model.extended(find("servo_lag")), fixed=dataset.fish.values)
    found = fit(lagging)
    assert found.values["servo_lag.time_constant"] == pytest.approx(0.04, abs=1e-4)
    assert find("servo_lag").not_applicable(dataset) == ""
    measured = replace(dataset, trials=tuple(replace(trial, commanded=False) for trial in dataset.trials))
    assert "measured" in find("servo_lag").not_applicable(measured)


@pytest.mark.parametrize(("hold", "late"), [("zero", 0.5), ("linear", 0.0)])
def test_a_command_is_held_until_the_next(hold: Hold, late: float) -> None:
    """Half a step late, on average; smoothly to the next it is not late."""
    (trial,) = commanded(0.0).trials
    motion = requested_motion(None, replace(trial, hold=hold), 0.002)
    inside = (motion.time > 0.2) & (motion.time < 3.8)
    phase = 2.0 * np.pi * 2.0 * (motion.time[inside] - late * trial.step)
    np.testing.assert_allclose(motion.angle[inside[:-1], 0, 0], (0.12 * np.sin(phase))[: inside[:-1].sum()], atol=1e-4)


def test_commands_come_back_from_a_file(tmp_path: Path) -> None:
    dataset = commanded(0.0)
    save(dataset, tmp_path / "pool")
    (again,) = mjfish.load_dataset(tmp_path / "pool").trials
    assert again.commanded
    assert "recorded commands" in repr(again)


def test_commands_that_are_not_there_are_asked_for(tmp_path: Path) -> None:
    save(mjfish.generate("pike", ["v1"], duration=2.0), tmp_path / "pool")
    file = tmp_path / "pool" / "dataset.toml"
    file.write_text(file.read_text().replace('name = "v1"', 'name = "v1"\njoints = "commanded"'))
    with pytest.raises(InputError, match="has no columns of joint angles"):
        mjfish.load_dataset(tmp_path / "pool")
