"""A misfit that sits in one run is not imitated by several causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.data import Dataset
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.compared import outlying_run, outlying_run_finding
from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.effects import catalogue, of_fish
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate

NOISE = np.array([0.004, 0.004, 0.03])
MODES = ["v1", "v3", "v5", "v1-t1", "v7"]


def _recorded(pike: Fish, odd: int | None, everywhere: float = 1.0) -> Dataset:
    """Return runs of which one was swum with other drag, a tenth more of the tail's and less of the body's."""
    values = {name: value * everywhere if name == "c_m.head" else value for name, value in pike.values.items()}
    data = generate(pike, MODES, values=values, noise=NOISE, duration=6.0, seed=4, held_out=["v7"])
    if odd is None:
        return data
    other = {**values, "c_d.tail": 1.2 * values["c_d.tail"], "c_d.body": 0.7 * values["c_d.body"]}
    swum = generate(pike, MODES, values=other, noise=NOISE, duration=6.0, seed=4, held_out=["v7"])
    trials = [swum.trials[i] if i == odd else trial for i, trial in enumerate(data.trials)]
    return replace(data, trials=tuple(trials))


def _evidence(data: Dataset) -> Evidence:
    problem = Problem(Model(data.fish), data.split()[0], Noise.white(NOISE))
    formulas = [effect for effect in of_fish(catalogue(), data.fish).values() if not effect.learned]
    return gather(problem, fit(problem), formulas)


@pytest.mark.parametrize("odd", [pytest.param(0, marks=pytest.mark.slow), 2, None])
def test_the_run_with_other_water_is_found(pike: Fish, odd: int | None) -> None:
    assert outlying_run(_evidence(_recorded(pike, odd))) == odd


def test_a_run_that_does_not_go_with_its_repeat_is_suspect(pike: Fish) -> None:
    """The last run is scaled. Where no other has its drive, a cause that shows only there would do the same."""
    for modes, severity in ((["v1", "v5", "v1-t1", "v1"], "suspect"), (["v1", "v5", "v1-t1", "v3"], "remark")):
        data = generate(pike, [*modes, "v7"], noise=NOISE, duration=6.0, seed=4, held_out=["v7"])
        scaled = replace(data.trials[3], velocity=readonly(1.15 * data.trials[3].velocity))
        evidence = _evidence(replace(data, trials=(*data.trials[:3], scaled, data.trials[4])))
        assert outlying_run(evidence) == 3
        found = outlying_run_finding(evidence.problem.trials, 3)
        assert (found.code, found.severity, found.trials) == ("outlying-run", severity, (scaled.name,))


def test_of_three_runs_none_is_the_odd_one(pike: Fish) -> None:
    data = _recorded(pike, 0)
    fewer = replace(data, trials=(*data.trials[:3], *data.trials[4:]))
    assert outlying_run(_evidence(fewer)) is None


@pytest.mark.slow
def test_nothing_is_named_for_what_one_run_has(pike: Fish) -> None:
    result = diagnose(_recorded(pike, 2), jobs=1)
    assert result.verdict in ("unexplained", "cannot_tell"), result.message
    if result.verdict == "unexplained":
        assert "in run v5 alone" in result.message
        assert ("outlying-run", ("v5",)) in [(finding.code, finding.trials) for finding in result.checks.findings]
