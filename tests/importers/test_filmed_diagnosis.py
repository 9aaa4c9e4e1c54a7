"""The whole way on synthetic tracks: a fish that swims and rolls is filmed, imported, fitted and diagnosed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filmed_swimming import FISH, HEIGHTS, Swim

from mjfish.data import Dataset, importers, load_dataset, save
from mjfish.diagnosis import diagnose
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit, predict_held_out
from mjfish.model import Model

#: The head's markers over those of the plates as the mapping has it [m], and as the film has it.
_TAKEN, _TRUE = 0.1, float(HEIGHTS[0] - HEIGHTS[3])
#: Height of the head's markers that a fit must find: the roll is read off by the ratio of the two.
_HEIGHT = float(HEIGHTS[0]) * _TAKEN / _TRUE
_SHAPES = {"roll.frequency": 8.0, "roll.damping": 0.2}


def _swims(roll: float, seed: int) -> dict[str, Swim]:
    """Return runs at three beats that differ in amplitude, seen as the real camera saw its fish."""
    one = Swim(seconds=4.5, noise=0.4, roll=roll)
    return {
        "slow": replace(one, beat=0.6, seconds=6.0, seed=10 * seed),
        "fast": replace(one, beat=1.1, seed=10 * seed + 1),
        "unseen": replace(one, beat=0.85, seed=10 * seed + 2),
    }


def _filmed(folder: Path, roll: float, seed: int = 0) -> Dataset:
    files = [swim.write(folder / f"markers_{name}.csv") for name, swim in _swims(roll, seed).items()]
    return importers.import_files("fishsim", files, ["unseen"])[0]


@pytest.fixture(scope="module")
def rolling(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return _filmed(tmp_path_factory.mktemp("rolling"), 0.12)


def test_fish_that_rolls_is_predicted_on_an_unseen_run_and_its_height_is_found(rolling: Dataset) -> None:
    """Without roll in the model sway is far off; with it the height is the true one, and the unseen run holds."""
    assert rolling.noise is not None
    fitted, held = rolling.split()
    nominal = Problem(Model(rolling.fish), fitted, Noise.white(rolling.noise))
    wide = replace(nominal, model=nominal.model.extended(find("roll")), fixed=_SHAPES)
    plain, found = fit(nominal), fit(wide)
    assert found.sse < 0.5 * plain.sse
    assert found.values["roll.height"] == pytest.approx(_HEIGHT, rel=0.12)
    before, after = (
        predict_held_out(one, done.values, held).residuals[0] for one, done in ((nominal, plain), (wide, found))
    )
    swing = np.ptp(held[0].velocity, axis=0)
    assert abs(after[:, 0].mean()) < 0.010
    assert np.sqrt(np.mean(after[:, 2] ** 2)) < 0.06 * swing[2]
    assert np.sqrt(np.mean(after[:, 1] ** 2)) < 0.6 * np.sqrt(np.mean(before[:, 1] ** 2))


def test_drag_of_the_tail_comes_back_from_film(rolling: Dataset) -> None:
    """The coefficient that thrust rests on; it pays for joint angles that are off by 0.02 rad and more."""
    assert rolling.noise is not None
    fitted, _ = rolling.split()
    model = Model(rolling.fish).extended(find("roll"))
    held = {f"c_m.{group}": FISH.values[f"c_m.{group}"] for group in ("head", "body", "tail")}
    found = fit(Problem(model, fitted, Noise.white(rolling.noise), fixed={**held, **_SHAPES}))
    assert found.values["c_d.tail"] == pytest.approx(FISH.values["c_d.tail"], rel=0.15)


@pytest.mark.slow
def test_a_roll_on_film_is_named(tmp_path: Path) -> None:
    """First on every film, by its formula or learned, named on three of four, and no other mechanism on any.

    The formula's height is right to a fifth.
    Of eight draws the height was off by 8 % (rms), and the added mass by up to 140 %. The importer puts the sway of the
    plates down to the joints, off by 0.1 rad: more than it states. Where that leaves more than a tenth unexplained,
    roll is told and not named (docs/notes/017): the verdict is `cannot_tell`, and no other cause is in it.
    """
    verdicts = []
    for seed in range(4):
        folder = tmp_path / str(seed)
        folder.mkdir()
        result = diagnose(_filmed(folder, 0.12, seed))
        verdicts.append(result.verdict)
        assert [find(name).mechanism for name in result.best] == ["roll"], result.message
        assert result.verdict in ("named", "cannot_tell"), result.message
        told = {find(name).mechanism for names in result.alternatives for name in names}
        assert told <= {"roll"}, result.message
        if "roll.height" in result.extended:
            assert result.extended["roll.height"].estimate == pytest.approx(_HEIGHT, rel=0.2)
        assert result.gain is not None
        assert result.gain.extended["sway"] < 0.6 * result.gain.nominal["sway"]
        assert result.gain.extended["pooled"] < 0.6 * result.gain.nominal["pooled"]
    assert verdicts.count("named") >= 3, verdicts


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_wrong_with_film_that_has_nothing_wrong(tmp_path: Path, seed: int) -> None:
    """The errors of filmed joint angles, 0.02 rad, are not taken for something wrong; nor by way of files."""
    dataset = _filmed(tmp_path, 0.0, seed)
    save(dataset, tmp_path / "dataset")
    result = diagnose(load_dataset(tmp_path / "dataset"))
    assert result.verdict == "nothing_wrong", result.message
    for group in ("head", "body", "tail"):
        truth = FISH.values[f"c_m.{group}"]
        assert result.nominal[f"c_m.{group}"].estimate == pytest.approx(truth, rel=0.1)
