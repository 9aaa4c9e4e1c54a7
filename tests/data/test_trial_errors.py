"""Modes of the errors of a smoothed record, in memory and in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trials
from mjfish.data import Dataset, Trial
from mjfish.data.trial import principal_modes
from mjfish.errors import InputError
from mjfish.fish import Fish


def _dataset(fish: Fish, modes: int = 4) -> Dataset:
    time = np.arange(40) / 20.0
    rng = np.random.default_rng(3)
    angle = 0.2 * np.sin(6.0 * time[:, None] - np.arange(4))
    errors = rng.standard_normal((modes, 40, 7)) * 1e-2
    still = np.zeros((40, 3))
    return Dataset("filmed", fish, (Trial("one", "fit", time, still, joint_angle=angle, errors=errors),))


def test_modes_come_back_from_files_to_the_last_bit(pike: Fish, tmp_path: Path) -> None:
    dataset = _dataset(pike)
    trials.save(dataset, tmp_path / "data")
    again = trials.load_dataset(tmp_path / "data").trials[0].errors
    assert again is not None
    np.testing.assert_array_equal(again, dataset.trials[0].errors)


def test_saving_again_without_errors_leaves_no_file_of_the_old_ones(pike: Fish, tmp_path: Path) -> None:
    dataset = _dataset(pike)
    trials.save(dataset, tmp_path / "data")
    plain = replace(dataset, trials=(replace(dataset.trials[0], errors=None),))
    trials.save(plain, tmp_path / "data")
    assert sorted(path.name for path in (tmp_path / "data").iterdir()) == ["dataset.toml", "one.csv"]


def test_modes_of_other_samples_are_refused(pike: Fish, tmp_path: Path) -> None:
    dataset = _dataset(pike)
    errors = dataset.trials[0].errors
    assert errors is not None
    short = replace(dataset, trials=(replace(dataset.trials[0], errors=errors[:, 1:]),))
    with pytest.raises(InputError, match=r"trial 'one': errors .* expected \(40, 7\)"):
        trials.save(short, tmp_path / "data")
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: {name: column[:-1] for name, column in t.items()}, "modes 1, 2, ... one after another"),
        (lambda t: {**t, "time": t["time"] + 1e-3}, "each with the 40 times of trial 'one'"),
        (lambda t: {**t, "mode": t["mode"] + 1.0}, "modes 1, 2, ... one after another"),
        (lambda t: {name: t[name] for name in t if name != "joint_4"}, "expected mode"),
    ],
)
def test_a_table_of_other_modes_is_refused(pike: Fish, tmp_path: Path, change, said: str) -> None:  # type: ignore[no-untyped-def]
    trials.save(_dataset(pike), tmp_path / "data")
    path = tmp_path / "data" / "one.errors.parquet"
    table = change(trials.read_table(path))
    trials.write_table(path, {trials.columns.header(name): column for name, column in table.items()})
    with pytest.raises(InputError, match=said):
        trials.load_dataset(tmp_path / "data")


def test_principal_modes_have_the_covariance_of_the_errors() -> None:
    """Modes without their size, or a series of small numbers that is lost among large ones."""
    rng = np.random.default_rng(5)
    root = rng.standard_normal((3, 15, 6)) * np.array([1e-3, 1.0, 30.0])[:, None, None]
    modes = principal_modes(root)
    for series in range(3):
        expected = root[series] @ root[series].T
        np.testing.assert_allclose(modes[:, :, series].T @ modes[:, :, series], expected, atol=5e-3 * expected.max())
