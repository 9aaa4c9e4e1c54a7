"""How firmly a verdict is held: which splits are drawn, and what is counted of their diagnoses."""

from __future__ import annotations

import doctest
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from diagnosed import CAUSE, diagnosis

import mjfish
from mjfish.data import Dataset
from mjfish.diagnosis import Diagnosis, Share, Splits, diagnose_splits, splits
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.effects import find
from mjfish.errors import InputError, UnwritableError

_FEW = {name: find(name) for name in ("servo_lag", "time_offset")}
_FORM = NamedMechanism("servo_dynamics", "drive", "form", CAUSE, (CAUSE,), ())
_MECHANISM = replace(_FORM, level="mechanism")

#: Verdict of a stubbed diagnosis, with what it names.
Made = Callable[[], Diagnosis]


def _pool(runs: int, held_out: tuple[int, ...] = (), fish: str = "pike") -> Dataset:
    """Return short runs r0, r1, ... whose motion nobody looks at, those in these places held out."""
    (trial,) = mjfish.generate(fish, ["v1"], duration=1.0).trials
    roles = ["held_out" if k in held_out else "fit" if held_out else None for k in range(runs)]
    trials = tuple(replace(trial, name=f"r{k}", role=role) for k, role in enumerate(roles))
    return Dataset("pool", mjfish.load_fish(fish), trials)


def _rivals(certain: tuple[str, ...] = ()) -> Diagnosis:
    return replace(diagnosis("cannot_tell"), best=(CAUSE, "roll"), certain=certain)


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Callable[[Mapping[tuple[str, ...], Made]], list[Dataset]]:
    """Let diagnoses be made by hand, by the names of the held-out runs; return the datasets that were diagnosed."""

    def use(made: Mapping[tuple[str, ...], Made]) -> list[Dataset]:
        seen: list[Dataset] = []

        def diagnose(dataset: Dataset, **rest: Any) -> Diagnosis:
            seen.append(dataset)
            return replace(made.get(_held(dataset), diagnosis)(), dataset=dataset)

        monkeypatch.setattr(splits, "diagnose", diagnose)
        return seen

    return use


def _held(dataset: Dataset) -> tuple[str, ...]:
    return tuple(trial.name for trial in dataset.split()[1])


def _too_few() -> Diagnosis:
    raise InputError("pool: 9 numbers for 12 free parameters; give more data, or fix parameters")


def _five(stub: Callable[[Mapping[tuple[str, ...], Made]], list[Dataset]]) -> Splits:
    """Return five splits: two name servo dynamics, two leave rivals, one cannot be diagnosed."""
    stub(
        {
            ("r0",): lambda: diagnosis(mechanisms=(_FORM,)),
            ("r1",): lambda: diagnosis(mechanisms=(_MECHANISM,)),
            ("r2",): lambda: _rivals(certain=("roll",)),
            ("r3",): _rivals,
            ("r4",): _too_few,
        }
    )
    return diagnose_splits(_pool(5, held_out=(1,)), 9)


def test_what_is_named_and_what_is_only_the_best_are_counted_apart(stub: Any) -> None:
    """Shares are of the splits that could be diagnosed. Catches a best candidate that is counted as named."""
    found = _five(stub)
    assert found.verdicts == (Share("named", 2, 0.5), Share("cannot_tell", 2, 0.5))
    assert found.mechanisms == (
        Share("servo_dynamics", 2, 0.5, form=1, certain=0, not_named=2),
        Share("roll", 0, 0.0, form=0, certain=1, not_named=1),
    )
    assert [split.summary() for split in found.splits] == [
        "servo_dynamics (form)",
        "servo_dynamics",
        "certain: roll; not named: servo_dynamics",
        "not named: servo_dynamics, roll",
        "not diagnosed: pool: 9 numbers for 12 free parameters; give more data, or fix parameters",
    ]


def test_the_verdict_of_the_dataset_is_held_by_splits_that_claim_the_same(stub: Any) -> None:
    """A level may differ, a mechanism may not; that of rivals is another verdict where one of them is certain."""
    found = _five(stub)
    assert [split.declared for split in found.splits] == [False, True, False, False, False]
    assert found.agreeing == 2
    assert "The verdict named (servo_dynamics) came in 2 of 5 splits, the dataset's own among them" in found.summary()
    assert "By verdict: named 2, cannot_tell 2, not diagnosed 1. Possible splits: 5." in found.summary()
    assert "1 not diagnosed: pool: 9 numbers for 12 free parameters" in found.summary()
    stub({("r2",): lambda: _rivals(certain=("roll",)), ("r0",): _rivals, ("r1",): _rivals})
    rivals = diagnose_splits(_pool(3, held_out=(2,)), 3)
    assert rivals.headline().startswith("The verdict cannot_tell (certain: roll) came in 1 of 3 splits")


def test_the_summary_has_ten_lines_at_most(stub: Any) -> None:
    many = tuple(replace(_FORM, name=f"mechanism_{k}") for k in range(20))
    stub(dict.fromkeys([("r0",), ("r1",), ("r2",)], lambda: diagnosis(mechanisms=many)))
    assert len(diagnose_splits(_pool(3), 3).summary().splitlines()) == 10


def test_the_numbers_are_plain_json(stub: Any, tmp_path: Path) -> None:
    found = _five(stub)
    found.save(tmp_path / "splits.json")
    written = json.loads((tmp_path / "splits.json").read_text())
    assert (written["schema"], written["dataset"], written["diagnosed"], written["possible"]) == (1, "pool", 4, 5)
    assert written["mechanisms"][1] == {
        "name": "roll", "count": 0, "share": 0.0, "form": 0, "certain": 1, "not_named": 1,
    }  # fmt: skip
    first, *_, last = written["splits"]
    assert first["fitted"] == ["r1", "r2", "r3", "r4"]
    assert first["mechanisms"] == [{"name": "servo_dynamics", "level": "form"}]
    assert first["gain"] == diagnosis().to_dict()["gain"]
    assert (last["verdict"], last["gain"]) == (None, None)


def test_splits_have_the_sizes_of_the_dataset_and_none_comes_twice(stub: Any) -> None:
    """Its own split among those drawn is not diagnosed twice."""
    seen = stub({})
    dataset = _pool(6, held_out=(0, 3))
    for count in (1, 7, 14, 15, 40):
        del seen[:]
        found = diagnose_splits(dataset, count, seed=3)
        held = [split.held_out for split in found.splits]
        assert len(set(held)) == len(held) == min(count, 15) == len(found.splits)
        assert all(len(split.held_out) == 2 and len(split.fitted) == 4 for split in found.splits)
        assert all({*split.fitted, *split.held_out} == {f"r{k}" for k in range(6)} for split in found.splits)
        assert found.possible == 15
        assert seen[0] is dataset
        assert [_held(one) for one in seen[1:]] == [names for names in held if names != ("r0", "r3")]
        assert [split.held_out for split in found.splits if split.declared] == [("r0", "r3")] * (("r0", "r3") in held)


def test_the_seed_draws_the_splits(stub: Any) -> None:
    stub({})
    dataset = _pool(9, held_out=(0, 3, 6))
    drawn = [[split.held_out for split in diagnose_splits(dataset, 6, seed=seed).splits] for seed in (0, 0, 1)]
    assert drawn[0] == drawn[1] != drawn[2]
    places = {
        name for seed in range(20) for split in diagnose_splits(dataset, 1, seed=seed).splits for name in split.held_out
    }
    assert places == {trial.name for trial in dataset.trials}


def test_a_third_is_held_out_where_the_dataset_holds_out_none(stub: Any) -> None:
    """Whether it gives no roles, or lets all runs be fitted: then its own split is none of those drawn."""
    stub({})
    free = _pool(5)
    fitted = replace(free, trials=tuple(replace(trial, role="fit") for trial in free.trials))
    for dataset, own in ((free, 1), (fitted, 0)):
        found = diagnose_splits(dataset, 99)
        assert {len(split.held_out) for split in found.splits} == {2}
        assert found.possible == len(found.splits) == 10
        assert sum(split.declared for split in found.splits) == own
    assert "own among them" not in found.headline()


def test_progress_goes_from_nothing_to_all_and_says_which_split(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[str, float]] = []

    def diagnose(dataset: Dataset, *, progress: Any, **rest: Any) -> Diagnosis:
        progress("begin", 0.0)
        progress("done", 1.0)
        return replace(diagnosis(), dataset=dataset)

    monkeypatch.setattr(splits, "diagnose", diagnose)
    diagnose_splits(_pool(3), 3, progress=lambda what, done: told.append((what, done)))
    assert [what for what, _ in told[::2]] == ["as divided: begin", "split 1 of 2: begin", "split 2 of 2: begin"]
    assert [done for _, done in told] == pytest.approx([0.0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize(
    ("runs", "count", "message"),
    [
        (4, 0, r"splits: found 0, expected 1 or more; give the number"),
        (2, 5, r"pool: 2 runs, expected 3 or more to divide anew; record 1 more"),
        (1, 5, r"pool: 1 run, expected 3 or more to divide anew; record 2 more"),
    ],
)
def test_what_cannot_be_divided_is_refused_before_any_diagnosis(stub: Any, runs: int, count: int, message: str) -> None:
    seen = stub({})
    with pytest.raises(InputError, match=message):
        diagnose_splits(_pool(runs), count)
    assert not seen


def test_a_dataset_that_cannot_be_diagnosed_itself_is_refused(stub: Any) -> None:
    stub({("r1",): _too_few})
    with pytest.raises(InputError, match="9 numbers for 12"):
        diagnose_splits(_pool(3, held_out=(1,)), 3)


def test_a_folder_without_room_ends_all_splits(stub: Any) -> None:
    """No split could keep its refits there: it is not one that cannot be diagnosed."""

    def full() -> Diagnosis:
        raise UnwritableError("kept: cannot be written: No space left on device")

    stub({("r2",): full})
    with pytest.raises(UnwritableError, match="No space left"):
        diagnose_splits(_pool(4, (3,)), count=4)


@pytest.mark.slow
def test_a_strong_effect_is_named_in_every_split_that_has_the_numbers_for_it() -> None:
    """No stub: each row is the diagnosis of the dataset divided so. The third run is too short to be fitted alone."""
    hidden = {"values": {"servo_lag.time_constant": 0.04}, "noise": (0.004, 0.004, 0.03), "seed": 2}
    long = mjfish.generate("pike", ["v1", "v5"], duration=4.0, **hidden)
    (short,) = mjfish.generate("pike", ["v3"], duration=0.04, **hidden).trials
    runs = (*(replace(trial, role="held_out") for trial in long.trials[:1]), replace(long.trials[1], role="fit"))
    dataset = replace(long, trials=(*runs, replace(short, role="held_out")))
    found = diagnose_splits(dataset, 3, effects=_FEW, jobs=1)
    assert [(split.fitted, split.verdict) for split in found.splits] == [
        (("v3",), None), (("v5",), "named"), (("v1",), "named"),
    ]  # fmt: skip
    assert "numbers for" in found.splits[0].message
    assert found.mechanisms[0].name == "servo_dynamics"
    assert found.mechanisms[0].count == 2
    again = replace(
        dataset, trials=tuple(replace(t, role="fit" if t.name == "v1" else "held_out") for t in dataset.trials)
    )
    assert found.splits[2].gain == mjfish.diagnose(again, effects=_FEW, jobs=1).gain


@pytest.mark.slow
def test_the_example_runs() -> None:
    globs = {"mjfish": mjfish}
    example = doctest.DocTestParser().get_doctest(diagnose_splits.__doc__ or "", globs, "splits", None, 0)
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0
