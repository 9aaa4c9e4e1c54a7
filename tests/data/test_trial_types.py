"""Which trials are held out; the text of a dataset."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Dataset, Role, Trial
from mjfish.fish import Fish


def dataset(fish: Fish, roles: list[Role | None]) -> Dataset:
    empty = np.zeros(0), np.zeros((0, 3))
    return Dataset("d", fish, tuple(Trial(str(number), role, *empty) for number, role in enumerate(roles)))


@pytest.mark.parametrize(
    ("count", "held"),
    [(1, []), (2, [1]), (3, [1]), (4, [1]), (5, [1, 4]), (6, [1, 4]), (8, [1, 4, 7]), (10, [1, 4, 7])],
)
def test_without_roles_a_third_is_held_out(count: int, held: list[int], pike: Fish) -> None:
    fit, out = dataset(pike, [None] * count).split()
    assert [trial.name for trial in out] == [str(number) for number in held]
    assert [trial.name for trial in fit] == [str(number) for number in range(count) if number not in held]


def test_with_roles_trials_without_one_are_fitted(pike: Fish) -> None:
    fit, out = dataset(pike, [None, "held_out", "fit", "held_out", None]).split()
    assert [trial.name for trial in fit] == ["0", "2", "4"]
    assert [trial.name for trial in out] == ["1", "3"]


def test_a_role_of_fit_alone_holds_nothing_out(pike: Fish) -> None:
    fit, out = dataset(pike, [None, "fit", None]).split()
    assert [trial.name for trial in fit] == ["0", "1", "2"]
    assert out == ()


def test_a_dataset_prints_at_most_ten_lines_and_no_arrays(pike: Fish) -> None:
    time = np.linspace(0.0, 5.0, 101)
    trials = tuple(Trial(f"t{number}", "fit", time, np.zeros((101, 3))) for number in range(12))
    lines = repr(Dataset("pool", pike, trials, noise=np.array([0.01, 0.02, 0.3]))).splitlines()
    assert len(lines) == 10
    assert lines[0] == "<Dataset 'pool': fish 'pike', 12 trials, clock synchronised"
    assert lines[1] == "  noise: surge 0.01 m/s, sway 0.02 m/s, yaw rate 0.3 rad/s"
    assert lines[2] == "  <Trial 't0', role fit: 101 samples in 5 s (20 Hz), driven by measured joint angles>"
    assert lines[-1] == "  and 5 more trials>"
