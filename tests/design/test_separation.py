"""Lambda is what a refit measures; a repeat turns nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from synthetic_trials import DURATION, swum, synthetic

from mjfish.data import Dataset
from mjfish.design.fitted_models import FittedModels, ModelEstimate
from mjfish.design.information import Information, Separation, separations
from mjfish.design.menu import Menu, Run
from mjfish.diagnosis.evidence import gather
from mjfish.effects import catalogue, find
from mjfish.estimation import fit
from mjfish.execution.progress import silent
from mjfish.numerics.arrays import solve

CASES = {
    "clock": ("time_offset", "servo_lag", {"time_offset.offset": -0.003}),
    "current": ("ambient_current", "frame_misalignment", {"ambient_current.y": 0.004}),
    "drag": ("reynolds_drag", "linear_drag", {"reynolds_drag.friction": 0.3}),
}

RUNS = ("steady-30", "step-down")


def _rivals(dataset: Dataset, *names: str) -> tuple[ModelEstimate, ...]:
    known = FittedModels.undiagnosed(dataset, catalogue())
    return known.estimates([find(name) for name in names], silent)


def _separation(dataset: Dataset, names: tuple[str, str], runs: Sequence[Run]) -> Separation:
    (found,) = separations(_rivals(dataset, *names), runs)
    return found


@pytest.mark.parametrize("case", ["clock", "current", pytest.param("drag", marks=pytest.mark.slow)])
def test_lambda_predicted_is_lambda_measured_once_the_run_is_swum(case: str) -> None:
    """Noise-free: the misfit of the wrong rival, refitted to old and new data.

    A baseline that is not projected out again with the new run would predict several times as much.
    """
    truth, rival, sizes = CASES[case]
    rivals = _rivals(synthetic(truth, sizes), truth, rival)
    runs = [
        run
        for run in Menu(DURATION).runs(synthetic(truth, sizes))
        if run.name in ("steady-30", "step-down", "steady-9")
    ]
    (apart,) = separations(rivals, runs)
    assert apart.noncentrality_of(truth) == pytest.approx(apart.margin, rel=0.05, abs=0.1)
    for i, run in enumerate(runs):
        new = swum(run.trial, truth, sizes)
        sse = []
        for one in rivals:
            problem = replace(one.problem, trials=(*one.problem.trials, new))
            sse.append(fit(problem, one.x, tolerance=1e-7).sse)
        assert apart.noncentrality_of(truth, i) == pytest.approx(sse[1] - sse[0], rel=0.2), run.name


def test_lambda_of_a_small_effect_is_that_of_the_score_tests() -> None:
    """psi_k' (I_kk - I_kl I_ll^+ I_lk) psi_k of the information after the baseline's refit."""
    truth, rival, sizes = "time_offset", "frame_misalignment", {"time_offset.offset": 0.001}
    dataset = synthetic(truth, sizes)
    problem = FittedModels.undiagnosed(dataset, {}).problem
    evidence = gather(problem, fit(problem), [find(truth), find(rival)])
    k, l = (evidence.blocks[name] for name in (truth, rival))  # noqa: E741
    whole = evidence.information
    left = whole[k, k] - whole[k, l] @ np.linalg.pinv(whole[l, l]) @ whole[l, k]
    psi = np.array([0.001 / p.scale for p in evidence.amplitudes_of(truth)])
    apart = _separation(dataset, (truth, rival), ())
    assert apart.noncentrality_of(truth) == pytest.approx(float(psi @ left @ psi), rel=0.1)


def test_a_repeat_doubles_lambda_and_turns_no_signature() -> None:
    """Of one trial, the repeat is the same information again: nothing that a refit hides comes to light."""
    truth, rival, sizes = CASES["current"]
    dataset = synthetic(truth, sizes, ("v1",))
    again = [run for run in Menu(DURATION).runs(dataset) if run.repeat]
    assert [run.name for run in again] == ["v1-again"]
    apart = _separation(dataset, (truth, rival), again)
    for name in (truth, rival):
        assert apart.noncentrality_of(name, 0) == pytest.approx(2.0 * apart.noncentrality_of(name), rel=1e-6)


def test_a_repeat_has_a_clock_of_its_own() -> None:
    """What is a run's own is free in that run alone: the clock of the repeat is not that of the data."""
    truth, rival, sizes = CASES["current"]
    dataset = replace(synthetic(truth, sizes), clock="free")
    again = [run for run in Menu(DURATION).runs(dataset) if run.repeat]
    apart = _separation(dataset, (truth, rival), again)
    assert len(apart.runs) == len(again) == 2
    of_runs = ((one, (run.name,)) for one, run in zip(apart.runs, again, strict=True))
    for sums, owners in ((apart.data, ("v1", "v3")), *of_runs):
        assert sums is not None
        clocks = {name for name in sums.names if ":" in name}
        assert clocks == {f"{one}/{owner}:clock.offset" for one in (truth, rival) for owner in owners}
        assert all(sums.gram[i, i] > 1.0 for i, name in enumerate(sums.names) if name in clocks)


def test_sums_of_runs_join_columns_by_name() -> None:
    """A run's own nuisance stays its own; shared parameters add."""
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((30, 2)), rng.standard_normal((30, 3))
    d = rng.standard_normal(60)
    one = Information.of(("p", "q"), a, d[:30])
    two = Information.of(("q", "p", "r:clock"), b, d[30:])
    joined = np.zeros((60, 3))
    joined[:30, :2], joined[30:, [1, 0, 2]] = a, b
    left = d - joined @ np.linalg.lstsq(joined, d, rcond=None)[0]
    assert Information.joined([one, two]).unexplained == pytest.approx(float(left @ left))


def test_solve_leaves_out_what_nothing_moves() -> None:
    gram = np.array([[4.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(solve(gram, np.array([[2.0], [0.0]])), [[0.5], [0.0]])


def test_a_run_in_which_a_rival_diverges_is_not_possible() -> None:
    truth, rival, sizes = CASES["current"]
    dataset = synthetic(truth, sizes)
    run = next(run for run in Menu(DURATION).runs(dataset) if run.name == "steady-30")
    broken = replace(run.trial, name="broken", drive=(replace(run.trial.drive[0], omega=4000.0),))
    apart = _separation(dataset, (truth, rival), [run, Run("broken", "", broken)])
    assert apart.runs[0] is not None
    assert apart.runs[1] is None


def test_estimates_of_some_trials_are_moved_for_the_others() -> None:
    """By one Gauss-Newton step: what a fit to all of them finds. Without it the margin is 4 % too large."""
    truth, rival, sizes = CASES["current"]
    dataset = synthetic(truth, sizes)
    (whole,) = separations(_rivals(dataset, truth, rival), ())
    alone = _rivals(replace(dataset, trials=dataset.trials[:1]), truth, rival)
    both = [replace(one, problem=replace(one.problem, trials=dataset.trials)) for one in alone]
    (moved,) = separations(both, ())
    assert moved.margin == pytest.approx(whole.margin, rel=0.005)
    assert moved.noncentrality() == pytest.approx(whole.noncentrality(), rel=0.005)
    (unmoved,) = separations([replace(one, fitted=2) for one in both], ())
    assert unmoved.margin > 1.03 * whole.margin
