"""The search: its integration step, and where refits start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mjfish.data import Dataset
from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.diagnosis.refit import find_threshold, off_null, refit_with, refits
from mjfish.diagnosis.screening import screen
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.fit import multistart
from mjfish.estimation.identification import pose
from mjfish.fish import Fish, load_fish
from mjfish.model import Model, requested_motion
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.05])
LIMIT = find("servo_rate_limit")


@pytest.fixture(scope="module")
def pike() -> Fish:
    return load_fish("pike")


def _problem(dataset: Dataset) -> Problem:
    return Problem(Model(dataset.fish), dataset.trials, Noise.white(SIGMA))


def _limited(pike: Fish, sigma: FloatArray) -> tuple[Evidence, float]:
    """Return what speaks against the nominal model where the quickest joint is cut off at 98.5 %, and its slowness."""
    still = generate(pike, ["v5"], duration=2.0)
    slowness = 1.0 / (0.985 * float(np.abs(requested_motion(pike.cpg, still.trials[0], 0.005).rate).max()))
    values = {"servo_rate_limit.slowness": slowness}
    dataset = generate(pike, ["v1", "v3", "v5"], values=values, effects=[LIMIT], noise=sigma, duration=10.4, seed=2)
    problem = replace(_problem(dataset), noise=Noise.white(sigma))
    return gather(problem, fit(problem), [LIMIT]), slowness


@pytest.mark.parametrize("share", [pytest.param(0.3, marks=pytest.mark.slow), 0.02], ids=["noise", "hardly any noise"])
def test_a_limit_that_is_hardly_met_is_found_in_its_narrow_minimum(
    pike: Fish, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From sizes that do not feel it there is no way down. Catches starts that step over the minimum.

    With hardly any noise an idle limit differs from none by rounding, and is not felt for it. Under another noise the
    refit is taken on, though at a longer step it would leave more than none.
    """
    evidence, slowness = _limited(pike, share * SIGMA)
    found = refit_with(evidence, LIMIT)
    assert found.gain > 50.0
    (size,) = (found.fit.values[p.name] for p in found.effects[-1].parameters)
    assert size == pytest.approx(slowness, rel=0.004)
    monkeypatch.setattr(Problem, "rough", property(lambda one: replace(one, model=replace(one.model, step=0.05))))
    rough = found.problem.rough
    assert np.sum(rough.residual(found.fit.x) ** 2) > evidence.fit.sse
    again = refits(evidence, (LIMIT,), before={LIMIT.name: found})[LIMIT.name]
    assert again.gain > 0.99 * found.gain


@dataclass
class _Tried:
    """Starts of one amplitude, whose sum of squares `felt` gives."""

    felt: Callable[[float], float]
    starts: list[FloatArray]
    promised: list[float]

    def add(self, start: FloatArray) -> float:
        self.starts.append(start)
        self.promised.append(self.felt(float(start[0])))
        return self.promised[-1]


@pytest.mark.parametrize(
    ("felt", "edge"), [(lambda size: max(size - 0.3, 0.0), 0.3), (lambda size: size, None)], ids=["edge", "none"]
)
def test_sizes_just_above_an_edge_are_tried_where_there_is_one(
    felt: Callable[[float], float], edge: float | None
) -> None:
    """A joint feels no limit that is above its speed; it feels any lag, the smaller the less."""
    tried = _Tried(lambda size: 1e4 * felt(size), [], [])
    for size in (1e-3, 1e-3, 0.1, 0.2, 0.5, 1.0):
        tried.add(np.array([size]))
    before = len(tried.starts)
    find_threshold(tried, 0)  # type: ignore[arg-type]
    new = np.array(tried.starts[before:])[:, 0]
    if edge is None:
        assert len(new) == 1
    else:
        assert np.count_nonzero((new > edge) & (new < 1.06 * edge)) >= 5


def test_sizes_just_below_where_more_is_left_than_by_none_are_tried() -> None:
    """A joint that meets its limit now and then feels it from 0.3 on; from 0.48 on it meets it in every beat."""
    tried = _Tried(lambda size: 1e3 * (1.0 - (size > 0.3) * 0.1 + (size > 0.48) * 100.0 * (size - 0.479)), [], [])
    for size in (1e-3, 1e-3, 0.1, 0.2, 0.5, 1.0):
        tried.add(np.array([size]))
    find_threshold(tried, 0)  # type: ignore[arg-type]
    new = np.array(tried.starts)[:, 0]
    assert np.count_nonzero((new > 0.475) & (new < 0.48)) >= 2
    assert np.count_nonzero((new > 0.29) & (new < 0.31)) >= 5


@pytest.mark.parametrize(
    "off", [pytest.param(0.0, marks=pytest.mark.slow), 1.5], ids=["as generated", "runs off by a level"]
)
def test_levels_of_runs_do_not_hide_in_the_noise(pike: Fish, off: float) -> None:
    """No candidate explains that two runs are off by a constant each; a wandering camera would, but for patterns."""
    synthetic = generate(pike, ["v1", "v3"], noise=SIGMA, duration=5.2, seed=6)
    moved = [
        replace(trial, velocity=readonly(trial.velocity + off * sign * SIGMA))
        for trial, sign in zip(synthetic.trials, (1.0, -1.0), strict=True)
    ]
    problem = replace(_problem(synthetic), trials=tuple(moved))
    findings = screen(problem, (find("inertia_error"),), None, walks=True)
    assert (findings.p_wrong < 1e-6) is (off > 0.0)


@pytest.mark.parametrize(
    ("name", "short", "size"), [("servo_lag", "time_constant", 0.1), ("servo_backlash", "joint_1", 0.3)]
)
def test_no_refit_under_another_noise_is_worse_than_none(pike: Fish, name: str, short: str, size: float) -> None:
    """Where an earlier refit ended may be far off under the noise that is found later."""
    problem, effect = _problem(generate(pike, ["v1", "v3"], noise=SIGMA, duration=4.0, seed=5)), find(name)
    evidence = gather(problem, fit(problem), [effect])
    one = refit_with(evidence, effect)
    far = one.fit.x.copy()
    far[[p.name for p in one.problem.parameters].index(f"{name}.{short}")] = size
    found = refits(evidence, [effect], before={name: replace(one, fit=replace(one.fit, x=far))})[name]
    assert -0.5 < found.gain < 10.0
    assert found.gain == pytest.approx(evidence.fit.sse - found.fit.sse)


def test_no_size_that_would_show_is_cut_off() -> None:
    """Near zero, drag by the Reynolds number shows at less than a hundredth of its scale in good data."""
    drag, tail = find("reynolds_drag"), find("tail_compliance")
    visible = {"reynolds_drag.friction": 1e-3, "reynolds_drag.pressure": 1e9}
    lifted = off_null(drag, visible)
    friction, pressure = (lifted[f"reynolds_drag.{short}"] for short in ("friction", "pressure"))
    assert 0.0 < friction.low <= 1e-4
    assert pressure.low == pytest.approx(drag.least * pressure.scale)
    assert off_null(tail)["tail_compliance.compliance"].low == pytest.approx(0.02 * 0.05)


def test_the_nominal_fit_has_one_optimum_however_wrong_the_model_is(pike: Fish) -> None:
    """From its declared start, and of eight. Catches steps that stop short: trf ended 7 % above the best."""
    truth = {"time_offset.offset": -0.2, "servo_saturation.psi": 8.0}
    problem = pose(generate(pike, ["v1", "v5-v1", "v3-t2"], values=truth, noise=[0.006, 0.006, 0.04], duration=7.0))
    single = fit(problem, tolerance=1e-6)
    assert single.cost > 1e3 * single.count
    np.testing.assert_allclose(multistart(problem, 8).costs, single.cost, rtol=1e-4)
