"""Draws of a posterior: their distribution, their bounds, their files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from mjfish import sample, simulate
from mjfish.effects import find
from mjfish.errors import InputError, UnknownNameError
from mjfish.files.writing import write_json
from mjfish.fish import Fish
from mjfish.model import Model, extended
from mjfish.model.posterior import Posterior, truncated_normal, write_draws
from mjfish.numerics.arrays import FloatArray

LAG = "servo_lag.time_constant"
WIDE = (np.full(9, -50.0), np.full(9, 50.0))


@pytest.fixture
def posterior(pike: Fish) -> Posterior:
    """Three parameters, the second on its lower bound and correlated with the first; the third is a servo lag."""
    low = next(p.low for p in pike.parameters if p.name == "c_m.tail")
    sigma = np.array([0.05, 0.02, 0.002])
    correlation = np.array([[1.0, -0.8, 0.0], [-0.8, 1.0, 0.0], [0.0, 0.0, 1.0]])
    model = Model(pike, (find("servo_lag"),))
    mean, covariance = np.array([1.5, low, 0.02]), correlation * np.outer(sigma, sigma)
    return Posterior(model, ("c_d.tail", "c_m.tail", LAG), mean, covariance, np.zeros(3), 4)


def _drawn(posterior: Posterior, n: int, seed: int = 0) -> FloatArray:
    return posterior.draw(n, np.random.default_rng(seed))


def test_a_parameter_on_its_bound_is_half_normal_and_the_others_follow_it(posterior: Posterior) -> None:
    """What is left of the first beside the second has the variance that it has where the second stays."""
    x = _drawn(posterior, 4000)
    bound = posterior.mean[1]
    assert stats.kstest((x[:, 1] - bound) / 0.02, "halfnorm").pvalue > 1e-3
    assert stats.kstest((x[:, 2] - 0.02) / 0.002, "norm").pvalue > 1e-3
    left = (x[:, 0] - 1.5 + 0.8 * 0.05 / 0.02 * (x[:, 1] - bound)) / (0.05 * 0.6)
    assert stats.kstest(left, "norm").pvalue > 1e-3
    assert np.mean(x[:, 0]) < 1.5 - 0.02


@pytest.mark.slow
def test_draws_are_those_of_rejection() -> None:
    """Nine parameters, five of them on bounds. Catches walks that are too short, and arcs cut on the wrong side."""
    rng = np.random.default_rng(0)
    mixed = rng.standard_normal((9, 10))
    covariance, low, high, mean = mixed @ mixed.T, *(side.copy() for side in WIDE), np.zeros(9)
    low[:5], high[0], mean[5:] = 0.0, 0.5, rng.standard_normal(4)
    proposed = mean + rng.standard_normal((1_000_000, 9)) @ np.linalg.cholesky(covariance).T
    kept = proposed[np.all((low <= proposed) & (proposed <= high), axis=1)]
    assert len(kept) > 1000
    drawn = truncated_normal(mean, covariance, low, high, len(kept), rng)
    assert np.all((low <= drawn) & (drawn <= high))
    for k in range(9):
        assert stats.ks_2samp(drawn[:, k], kept[:, k]).pvalue > 1e-3
        assert stats.ks_2samp(drawn[:, k] * drawn[:, 0], kept[:, k] * kept[:, 0]).pvalue > 1e-3


@pytest.mark.slow
def test_a_parameter_without_variance_stays_and_one_that_nothing_tells_fills_its_bounds() -> None:
    drawn = truncated_normal(
        np.array([0.3, 0.0]), np.diag([0.0, 1e8]), np.zeros(2), np.array([1.0, 2.0]), 500, np.random.default_rng(3)
    )
    assert np.all(drawn[:, 0] == 0.3)
    assert stats.kstest(0.5 * drawn[:, 1], "uniform").pvalue > 1e-3


def test_scatter_adds_that_of_the_run_and_what_it_makes_of_the_mean(posterior: Posterior) -> None:
    """tau^2 (1 + 1 / runs) beside the error; of the others nothing changes."""
    wider = replace(posterior, scatter=np.array([0.0, 0.0, 0.003]), runs=2)
    x = _drawn(wider, 4000)
    assert np.std(x[:, 2]) == pytest.approx(np.sqrt(0.002**2 + 1.5 * 0.003**2), rel=0.04)
    assert stats.kstest((x[:, 2] - 0.02) / np.sqrt(0.002**2 + 1.5 * 0.003**2), "norm").pvalue > 1e-3
    assert stats.kstest((x[:, 1] - posterior.mean[1]) / 0.02, "halfnorm").pvalue > 1e-3


def test_a_file_gives_the_same_fish_as_the_result(posterior: Posterior, tmp_path: Path) -> None:
    """To the last bit, from the file, from its folder, and through the TOMLs of the draws."""
    write_json(tmp_path / "diagnosis.json", {"schema": 2, "posterior": posterior.to_dict()})
    draws = sample(SimpleNamespace(posterior=posterior), 5, seed=7)
    for place in (tmp_path / "diagnosis.json", str(tmp_path)):
        assert [draw.values for draw in sample(place, 5, seed=7)] == [draw.values for draw in draws]
    assert draws[0].values != draws[1].values
    assert draws[0].values != sample(tmp_path, 1, seed=8)[0].values
    files = write_draws(tmp_path / "draws", draws, ["Drawn for a test."])
    assert [file.name for file in files] == [f"draw_00{k}.toml" for k in range(1, 6)]
    assert files[0].read_text(encoding="utf-8").startswith("# Drawn for a test.\n")
    for file, draw in zip(files, draws, strict=True):
        back = extended.load(file)
        assert back.values == draw.values
        np.testing.assert_array_equal(simulate(file, duration=0.5).velocity, simulate(draw, duration=0.5).velocity)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_a_draw_takes_values_and_further_effects(posterior: Posterior) -> None:
    (draw,) = sample(SimpleNamespace(posterior=posterior), 1)
    run = simulate(draw, values={"munk_moment.kappa": 1.0, LAG: 0.03}, duration=0.5)
    assert run.effects == ("with servo_lag: time_constant = 0.03 s", "with munk_moment: kappa = 1")


def test_a_folder_that_holds_something_is_refused(posterior: Posterior, tmp_path: Path) -> None:
    """Else fish of an earlier call would be among the draws."""
    draws = sample(SimpleNamespace(posterior=posterior), 2)
    write_draws(tmp_path / "draws", draws)
    with pytest.raises(InputError, match="draws: is not empty, expected a new folder; choose another"):
        write_draws(tmp_path / "draws", draws[:1])
    assert len([*(tmp_path / "draws").iterdir()]) == 2


BAD = {
    "no file": (None, InputError, r"a.json: no such file; write it by 'mjfish diagnose"),
    "no JSON": ("{", InputError, r"a.json: cannot be read as JSON"),
    "no posterior": ('{"schema": 2}', InputError, r"a.json: has no posterior"),
    "a list": ("[]", InputError, r"a.json: has no posterior"),
    "a key": ("names", InputError, r"a.json: posterior: names: this key is missing; add it"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_none_is_refused(name: str, posterior: Posterior, tmp_path: Path) -> None:
    text, kind, message = BAD[name]
    if text == "names":
        saved = {key: value for key, value in posterior.to_dict().items() if key != "names"}
        text = json.dumps({"posterior": saved})
    if text is not None:
        (tmp_path / "a.json").write_text(text, encoding="utf-8")
    with pytest.raises(kind, match=message):
        sample(tmp_path / "a.json")


CHANGED = {
    "an effect": ({"effects": ["gremlin"]}, UnknownNameError, "unknown effect in .* 'gremlin'; .*--effects FILE"),
    "a parameter": ({"names": ["c_d.tail", "c_m.tail", "c_d.fin"]}, UnknownNameError, "'c_d.fin'; known: c_d.body"),
    "a number less": ({"mean": [1.5, 0.1]}, InputError, "expected 3 numbers of each kind"),
    "a row less": ({"covariance": [[1.0] * 3] * 2}, InputError, "expected 3 numbers of each kind"),
    "no run": ({"runs": 0}, InputError, "expected 3 numbers of each kind, one a name, and a run"),
    "text": ({"scatter": ["a", 0.0, 0.0]}, InputError, r"scatter.1: expected a number"),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_posterior_that_was_changed_by_hand_is_refused(name: str, posterior: Posterior, tmp_path: Path) -> None:
    change, kind, message = CHANGED[name]
    write_json(tmp_path / "a.json", {"posterior": {**posterior.to_dict(), **change}})
    with pytest.raises(kind, match=message):
        sample(tmp_path / "a.json")


def test_no_draw_and_no_posterior_are_refused(posterior: Posterior) -> None:
    with pytest.raises(InputError, match="found 0 draws with seed 0, expected 1 or more"):
        sample(SimpleNamespace(posterior=posterior), 0)
    with pytest.raises(InputError, match="the fit diverged and has no posterior"):
        sample(SimpleNamespace(posterior=None))
