"""A cause of one size, and one that only looks like it."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import row
from scipy import stats

from mjfish.data import Sensor, Trial
from mjfish.diagnosis.evidence import Evidence, gather, whitened_omnibus
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.refit import converged_formula, refit_with
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.select import Goodness, excused, of_all_runs, sizes_by_run
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import Effect, find
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.omnibus import HATS
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import orthonormal, project_out
from mjfish.simulation.synthetic import generate

NOISE = np.array([0.004, 0.004, 0.03])
MODES = ["v1", "v5", "v7", "v3-t1"]


@functools.cache
def _swum(values: tuple[tuple[str, float], ...], sensors: tuple[Sensor, ...] = ()) -> tuple[Trial, ...]:
    """Return runs of all modes with these values, made once."""
    effects = [find(name) for name in ("joint_zero_offset", "time_offset")]
    given = dict(values)
    return generate(
        load_fish("pike"), MODES, values=given, effects=effects, noise=NOISE, duration=6.0, seed=6, sensors=sensors
    ).trials


def _runs(offsets: list[float], sensors: tuple[Sensor, ...] = (), late: float = 0.0) -> tuple[Trial, ...]:
    """Return runs whose second joint is off, by an angle [rad] of each run; the clock of the last is late [s]."""
    found = []
    for i, offset in enumerate(offsets):
        delay = late * (i == len(offsets) - 1)
        found.append(_swum((("joint_zero_offset.joint_2", offset), ("time_offset.offset", delay)), sensors)[i])
    return tuple(found)


def _turbid(factors: list[float]) -> tuple[Trial, ...]:
    """Return runs whose second joint is off alike, in water in which the tail drags so many times more."""
    drag = load_fish("pike").values["c_d.tail"]
    values = [(("joint_zero_offset.joint_2", 0.01), ("c_d.tail", factor * drag)) for factor in factors]
    return tuple(_swum(one)[i] for i, one in enumerate(values))


@functools.cache
def _refit(trials: tuple[Trial, ...]) -> Refit:
    """Refit an angle of the second joint, once for the same runs."""
    return _refitted(Problem(Model(load_fish("pike")), trials, Noise.white(NOISE)), find("joint_zero_offset"))


def _refitted(problem: Problem, cause: Effect) -> Refit:
    return converged_formula(refit_with(gather(problem, fit(problem), [cause]), cause), np.inf)


def _sizes(refit: Refit, held_out: tuple[Trial, ...] = ()) -> tuple[float, int]:
    """Return the statistic of the sizes by run, and its degrees of freedom."""
    every = of_all_runs(refit, held_out)
    return sizes_by_run(refit, every).statistic(every.cleared)


@functools.cache
def _nominal(refit: Refit) -> Evidence:
    """Return the nominal fit to the runs of a refit, made once."""
    nominal = replace(refit.problem, model=replace(refit.problem.model, effects=()))
    return gather(nominal, fit(nominal), [])


def _goodness(refit: Refit, held_out: tuple[Trial, ...] = ()) -> Goodness:
    """Return what tests a refit by the score of a clock, in the runs that were fitted and in others."""
    return Goodness([find("time_offset")], HeldOut(_nominal(refit), held_out))


def test_one_size_in_all_runs_passes() -> None:
    trials = _runs([0.03] * 4)
    statistic, rank = _sizes(_refit(trials))
    assert rank == 12  # of the cause, and of added mass, drag and friction
    assert stats.chi2.sf(statistic, rank) > 1e-3
    statistic, rank = _sizes(_refit(trials[:3]), trials[3:])
    assert rank == 12  # of the cause, and of added mass, drag and friction
    assert stats.chi2.sf(statistic, rank) > 1e-3


def test_a_size_by_run_does_not() -> None:
    trials = _runs([0.02, 0.03, 0.05, 0.03])
    statistic, rank = _sizes(_refit(trials))
    assert rank == 12  # of the cause, and of added mass, drag and friction
    assert stats.chi2.sf(statistic, rank) < 1e-6


def test_a_held_out_run_of_another_size_is_seen() -> None:
    trials = _runs([0.03, 0.03, 0.03, 0.06])
    refit = _refit(trials[:3])
    assert stats.chi2.sf(*_sizes(refit)) > 1e-3
    assert stats.chi2.sf(*_sizes(refit, trials[3:])) < 1e-6


@pytest.mark.slow
def test_what_sensors_see_of_a_size_by_run_counts() -> None:
    """Those of a fitted run; of a held-out one the velocities alone do."""
    time = np.arange(0.0, 6.0, 0.02)
    gyro = Sensor("gyro", "gyro", time, np.zeros((len(time), 1)), sigma=np.array([0.006]))
    trials = _runs([0.03, 0.03, 0.0308, 0.03], sensors=(gyro,))
    blind = tuple(replace(trial, sensors=()) for trial in trials)
    assert stats.chi2.sf(*_sizes(_refit(blind))) > 1e-2
    assert stats.chi2.sf(*_sizes(_refit(trials))) < 1e-6
    refit = _refit(trials[:3])
    assert _sizes(refit, trials[3:]) == _sizes(refit, blind[3:])


def test_a_held_out_run_with_larger_noise_is_no_misfit() -> None:
    trials = _runs([0.03] * 4)
    noise = np.random.default_rng(1).standard_normal(trials[3].velocity.shape)
    noisy = replace(trials[3], velocity=trials[3].velocity + 2.0 * NOISE * noise)
    refit = _refit(trials[:3])
    assert stats.chi2.sf(*of_all_runs(refit, (noisy,)).omnibus) < 1e-6
    assert _goodness(refit, (noisy,)).of(refit, Row.of(refit.names, refit)).clean()


def test_what_belongs_to_a_held_out_run_alone_is_no_misfit(pike: Fish) -> None:
    """Catches a held-out run that is linearised at the start values of its clock and of its walk."""
    late = _runs([0.03] * 4, late=0.004)
    drag, names = find("linear_drag"), ["clock_wander", "linear_drag"]
    values = {"clock_wander.size": 0.006, "linear_drag.across": 40.0}
    walking = generate(
        pike, MODES, values=values, effects=[*map(find, names)], noise=NOISE, duration=6.0, seed=1
    ).trials
    for trials, cause, own in ((late, None, {"free_clock": True}), (walking, drag, {"walk": 0.006})):
        problem = replace(Problem(Model(pike), trials[:3], Noise.white(NOISE)), **own)
        refit = _refitted(problem, cause or find("joint_zero_offset"))
        row = _goodness(refit, trials[3:]).of(refit, Row.of(refit.names, refit))
        assert row.clean(), row.tests


def test_coefficients_that_differ_by_run_are_seen_in_held_out_runs_too() -> None:
    """No other test sees them as well: the cause has the same size in all runs, and the last run was not fitted."""
    for last, steady in ((1.0, True), (1.006, False)):
        trials = _turbid([1.0, 1.0, 1.0, last])
        refit = _refit(trials[:3])
        plain = Row.of(refit.names, refit, 0.0, 1.0)
        row = _goodness(refit, trials[3:]).of(refit, plain)
        assert (row.tests["sizes by run"] >= THRESHOLDS.goodness) is steady
        assert row.clean() is steady
        assert steady or row.tests["sizes by run"] == min(row.tests.values())
        assert _goodness(refit).of(refit, plain).clean()


def test_what_is_left_is_looked_for_in_held_out_runs_too() -> None:
    """A clock that is late in the last run alone, which was not fitted: a little, or so that nothing predicts it."""
    for delay, steady in ((0.0, True), (0.0003, False), (0.004, False)):
        trials = _runs([0.03] * 4, late=delay)
        refit = _refit(trials[:3])
        row = _goodness(refit, trials[3:]).of(refit, Row.of(refit.names, refit))
        assert (row.tests["waves"] >= THRESHOLDS.goodness) is steady
        assert (row.excess > 100.0) is not steady
        if delay < 0.001:
            assert row.beyond == pytest.approx(_refit(trials).gain - refit.gain, rel=0.05)


def test_outliers_of_the_noise_are_no_change_of_coefficients() -> None:
    trials = _turbid([1.0] * 4)
    rng = np.random.default_rng(2)
    spoiled = [replace(t, velocity=t.velocity.copy()) for t in trials]
    for trial in spoiled:
        rows = rng.choice(len(trial.time), 3, replace=False)
        trial.velocity[rows] += 30.0 * NOISE * rng.standard_normal((3, 3))
    refit = _refit(tuple(spoiled))
    row = _goodness(refit).of(refit, Row.of(refit.names, refit, 0.0, 1.0))
    assert row.tests["sizes by run"] >= THRESHOLDS.goodness
    assert row.clean()


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_common_waves_are_the_sums_of_those_of_runs(pike: Fish, share: float) -> None:
    """What is small in each run and the same in all is seen by fifteen numbers; the whole basis has sixty a run."""
    effects = [find("fin_lift")] if share else []
    pool = generate(
        pike, MODES, values={"fin_lift.slope": share} if share else {}, effects=effects, noise=NOISE, duration=6.0,
        seed=2,
    )  # fmt: skip
    problem = Problem(Model(pike), pool.trials, Noise.white(NOISE))
    evidence = gather(problem, fit(problem), [find("time_offset")])
    waves = whitened_omnibus(problem).dense()
    summed = waves.reshape(len(waves), len(pool.trials), 3, HATS, -1).sum(axis=(1, 3)).reshape(len(waves), -1)
    basis = orthonormal(evidence.fit.jacobian.dense()[:, ~evidence.fit.at_bound])
    beyond = orthonormal(project_out(basis, summed))
    statistic, rank = evidence.common()
    assert rank == 15
    assert statistic == pytest.approx(float(np.sum((beyond.T @ evidence.cleared) ** 2)), rel=1e-6)
    assert (stats.chi2.sf(statistic, rank) < 1e-4) == bool(share)


@pytest.mark.parametrize(
    ("name", "tolerance"), [("joint_zero_offset", 0.03), ("reynolds_drag", 0.1), ("servo_backlash", 0.1)]
)
def test_numbers_without_a_form_may_leave_less(name: str, tolerance: float) -> None:
    """What a law leaves may be due to its form; an angle has none."""
    alone = row((name,), 100.0, 0.0, 1.0)
    assert alone.tolerated() == tolerance
    assert replace(alone, learned=True).tolerated() == 0.03
    assert replace(alone, mechanisms=(find(name).mechanism, "drag_law")).tolerated() == 0.1
    assert replace(alone, mechanisms=("of_a_user",)).tolerated() == 0.1


def test_what_is_slight_beside_the_gain_is_not_held_against_a_cause() -> None:
    assert excused((60.0, 15), lambda: 0.0, slight=44.0) == (pytest.approx(2.522e-7, rel=1e-3), (60.0, 15))
    assert excused((60.0, 15), lambda: 0.0, slight=46.0) == (1.0, (60.0, 15))
