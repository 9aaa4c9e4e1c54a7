"""Fits from many starts, robust fits, weights: on short synthetic trials."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import TRUTH, off_truth, problem, swimming

from mjfish.data import Dataset
from mjfish.errors import InputError
from mjfish.estimation.fit import fit, hypercube, multistart
from mjfish.estimation.identification import identify
from mjfish.estimation.settings import Settings
from mjfish.execution import executing
from mjfish.fish import Fish
from mjfish.numerics.arrays import readonly

#: The package exports its function `fit` under the name of the module.
MODULE = importlib.import_module("mjfish.estimation.fit")


@pytest.fixture(scope="module")
def synthetic() -> Dataset:
    from mjfish.fish import load_fish

    return swimming(load_fish("pike"), ("v1", "v5"))


def _few(synthetic: Dataset, **changes: object) -> Settings:
    fixed = {name: TRUTH[name] for name in COEFFICIENTS if name[:3] == "c_f" or name.endswith("head")}
    return Settings(**{"fixed": fixed, **changes})  # type: ignore[arg-type]


def test_the_same_seed_gives_the_same_answer_for_any_number_of_jobs(synthetic: Dataset) -> None:
    """A draw inside a thread, or a fit that goes on from another's end, would show."""
    one = problem(synthetic)
    with executing(1):
        a = multistart(one, 3, seed=5)
    with executing(3):
        b = multistart(one, 3, seed=5)
    np.testing.assert_array_equal(a.optima, b.optima)
    np.testing.assert_array_equal(a.best.x, b.best.x)
    assert not np.array_equal(hypercube(one, 2, 5), hypercube(one, 2, 6))


def test_the_hypercube_fills_the_bounds_and_leaves_what_belongs_to_a_trial(pike: Fish) -> None:
    posed = problem(swimming(pike, ("v1",)), free_clock=True)
    starts = hypercube(posed, 8, 0)
    low, high = (np.array([getattr(p, end) for p in posed.parameters[:9]]) for end in ("low", "high"))
    cells = np.floor((starts[:, :9] - low) / (high - low) * 8)
    assert all(sorted(column) == list(range(8)) for column in cells.T)
    np.testing.assert_array_equal(starts[:, 9:], np.tile(posed.start()[9:], (8, 1)))


def test_every_start_finds_the_optimum_of_a_problem_that_has_one(synthetic: Dataset) -> None:
    found = identify(synthetic, _few(synthetic, starts=4), jobs=1)
    assert found.fit.status == "converged"
    assert (found.starts, found.reached) == (4, 1.0)


def test_a_start_that_ends_elsewhere_is_counted(synthetic: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    honest, calls = MODULE.fit, []

    def stuck(posed: object, x: object, **options: object) -> object:
        calls.append(x)
        one = honest(posed, x, **options)  # type: ignore[arg-type]
        return replace(one, cost=2.0 * one.cost) if len(calls) == 2 else one

    monkeypatch.setattr(MODULE, "fit", stuck)
    assert multistart(problem(synthetic), 2, seed=1).reached == 0.5


def test_where_every_start_diverges_none_reached_anything(synthetic: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = MODULE.fit
    monkeypatch.setattr(MODULE, "fit", lambda *a, **k: replace(honest(*a, **k), status="diverged"))
    assert multistart(problem(synthetic), 2, seed=1).reached == 0.0


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy"])
def test_a_robust_loss_bears_outliers_that_least_squares_does_not(synthetic: Dataset, loss: str) -> None:
    """Two in a hundred samples of surge far off, one-sided, as where a marker is swapped."""
    rng = np.random.default_rng(2)
    trials = []
    for trial in synthetic.trials:
        velocity = trial.velocity.copy()
        hit = rng.choice(len(velocity), len(velocity) // 50, replace=False)
        velocity[hit, 0] += 0.5
        trials.append(replace(trial, velocity=readonly(velocity)))
    spoilt = replace(synthetic, trials=tuple(trials))
    plain = identify(spoilt, _few(synthetic, starts=1), jobs=1).fit
    robust = identify(spoilt, _few(synthetic, starts=1, loss=loss), jobs=1).fit
    names = [p.name for p in robust.parameters]
    off = {n: [abs(one.values[n] - TRUTH[n]) for n in names] for n, one in (("plain", plain), ("robust", robust))}
    assert np.linalg.norm(off["robust"]) < 0.5 * np.linalg.norm(off["plain"])


def test_the_papers_weights_give_another_estimate_that_is_right_too(synthetic: Dataset) -> None:
    noise = identify(synthetic, _few(synthetic, starts=1), jobs=1).fit
    paper = identify(synthetic, _few(synthetic, starts=1, weights="paper"), jobs=1)
    assert not np.allclose(noise.x, paper.fit.x, rtol=1e-6)
    np.testing.assert_allclose(paper.fit.x, noise.x, rtol=0.2)
    np.testing.assert_allclose(paper.noise, [0.01, 0.01, np.pi / 180.0])


def test_fixed_parameters_stay_and_the_rest_is_found(synthetic: Dataset) -> None:
    one = identify(synthetic, _few(synthetic, starts=1), jobs=1).fit
    assert [p.name for p in one.parameters] == ["c_m.body", "c_m.tail", "c_d.body", "c_d.tail"]
    off = [(one.values[n] - TRUTH[n]) / one.sigma[n] for n in one.values]
    assert np.abs(off).max() < 4.0


def test_fewer_data_than_parameters_are_refused(synthetic: Dataset) -> None:
    trial = synthetic.trials[0]
    short = replace(trial, time=readonly(trial.time[:3]), velocity=readonly(trial.velocity[:3]))
    with pytest.raises(InputError, match="9 numbers for 9 free parameters; give more data, or fix parameters"):
        identify(replace(synthetic, trials=(short,)), Settings(starts=1))


def test_a_channel_without_variation_is_said(synthetic: Dataset) -> None:
    flat = [replace(t, velocity=readonly(t.velocity * [1.0, 0.0, 1.0])) for t in synthetic.trials]
    found = identify(replace(synthetic, trials=tuple(flat)), _few(synthetic, starts=1), jobs=1)
    assert any("v1: sway does not vary" in remark for remark in found.remarks)


def test_estimates_lie_within_their_errors_from_a_far_start(pike: Fish) -> None:
    """All nine, from the corner of the bounds; catches a slip in the scaling or the Jacobian of the fit."""
    posed = problem(swimming(pike))
    one = fit(posed, np.array([p.high for p in posed.parameters]))
    assert one.status == "converged"
    assert np.abs(off_truth(one.values, one.sigma)).max() < 4.5
    assert one.cost == pytest.approx(one.sse, rel=1e-6)
