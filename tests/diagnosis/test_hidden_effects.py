"""An effect is hidden in the data and must be found; where there is none, none may be found."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hidden_cases import STRONG, draw, trace
from scipy import stats

from mjfish.diagnosis import Diagnosis, Estimate, diagnose
from mjfish.effects import catalogue, find
from mjfish.estimation import fit

#: Causes that the free coefficients hide (see below), one that needs a tank (tests/effects/test_wall_effect.py), one
#: that needs a camera (test_poses.py), one that is random (test_wandering_clock.py).
ELSEWHERE = ("camera_tilt", "clock_wander", "lens_distortion", "mass_error", "section_height", "wall_effect")
#: A hidden cause of each domain. The slow tests hide all of them and ask the whole catalogue; tests/effects recovers
#: the size of each by a fit.
OF_EACH_DOMAIN = ("munk_moment", "velocity_scale", "joint_zero_offset", "com_offset", "roll")
#: Sum of squares below which an effect leaves no trace to speak of, before any refit.
LEAST = 30.0
#: Half-widths of the 95 % interval that make one of 99.9 %: of two dozen intervals one would miss at 95 %.
WIDER = 3.29 / 1.96


def _holds(value: Estimate, truth: float) -> bool:
    """Return whether the 99.9 % interval contains the truth."""
    low, high = (value.estimate + WIDER * (end - value.estimate) for end in (value.low, value.high))
    return bool(low <= truth <= high)


def _contains(result: Diagnosis, effect: str, truth: Mapping[str, float]) -> bool:
    """Return whether the truth is in the 99.9 % region of all numbers of the cause: a likelihood ratio.

    Sizes and a shape trade along a curve, which no interval of one of them follows.
    """
    own = [p.name for p in find(effect).parameters if p.name in truth]
    problem = replace(result.problem, model=result.extended_model)
    (found,) = [model for model in result.fits if model.causes == (effect,)]
    fixed = {**problem.fixed, **{name: truth[name] for name in own}}
    held = replace(problem, fixed=fixed)
    told = fit(
        held, held.start({name: value for name, value in found.values.items() if name not in fixed}), tolerance=1e-6
    )
    return told.sse - found.sse < stats.chi2.ppf(0.999, len(own))


def _mechanisms(result: Diagnosis) -> list[str]:
    return [named.name for named in result.mechanisms]


def _assert_found(effect: str, *, by_mechanism: bool = False, candidates: Sequence[str] = ()) -> None:
    """Hide a strong effect, and want its formula with its numbers; or, where that is enough, its mechanism."""
    case = draw(effect, "strong")
    known = {name: find(name) for name in candidates} or None
    result = diagnose(case.dataset, effects=known, jobs=1)
    case_and_result = f"{case.dataset.name}, truth {case.truth}: {result.message} {result.candidates}"
    assert result.verdict == "named", case_and_result
    assert _mechanisms(result) == [find(effect).mechanism], case_and_result
    if by_mechanism and [cause.name for cause in result.causes] != [effect]:
        return
    assert [cause.name for cause in result.causes] == [effect], case_and_result
    curved = any(parameter.shape for parameter in find(effect).parameters)
    assert not curved or _contains(result, effect, case.truth), case_and_result
    for parameter in find(effect).parameters:
        value = result.causes[0].parameters[parameter.short]
        if not curved:
            assert _holds(value, case.truth[parameter.name]), f"{parameter.name}: {value}; {case_and_result}"
    assert result.gain is not None
    assert result.gain.relative_reduction > 0.0, case_and_result
    assert [member.name for member in result.extended_model.effects] == [effect]
    assert result.status == "ok"


def test_a_hidden_effect_is_named_among_candidates_of_every_domain() -> None:
    _assert_found(OF_EACH_DOMAIN[0], candidates=OF_EACH_DOMAIN)


@pytest.mark.slow
@pytest.mark.parametrize("effect", OF_EACH_DOMAIN)
def test_a_hidden_effect_is_named_with_its_size_and_gains_on_held_out_trials(effect: str) -> None:
    _assert_found(effect)


@pytest.mark.slow
@pytest.mark.parametrize("effect", sorted(set(STRONG) - set(OF_EACH_DOMAIN)))
def test_the_other_hidden_effects_are_named_too(effect: str) -> None:
    _assert_found(effect, by_mechanism=True)


def test_every_cause_of_the_catalogue_is_hidden_once_or_cannot_be_seen() -> None:
    """A cause that is added must be added here, but for learned forms: these are to find what no formula is."""
    formulas = {name for name, effect in catalogue().items() if not effect.learned}
    assert formulas == set(STRONG) | set(ELSEWHERE)
    assert {find(name).domain for name in OF_EACH_DOMAIN} == {effect.domain for effect in catalogue().values()}


@pytest.mark.slow
@pytest.mark.parametrize("effect", STRONG)
def test_smaller_draws_of_a_hidden_effect_are_named_too(effect: str) -> None:
    """Of a middling and a weak one one may get no name (a true cause is lost in four of a thousand), none another.

    Where the data do not bear the formula, the mechanism is named, by another form or a learned one. A weak one may
    have rivals; a servo that is hardly asked for more than its limit leaves no trace and does not count.
    """
    found, right = [], [find(effect).mechanism]
    for strength in ("middling", "weak"):
        result = diagnose(draw(effect, strength, 1).dataset, jobs=1)
        names = _mechanisms(result)
        rival = strength == "weak" and (effect,) in result.alternatives
        lost = not rival and names != right and trace(effect, strength, 1) > LEAST
        found.append((lost, names, result.verdict, result.message))
    assert all(names in ([], right) for _, names, _, _ in found), found
    assert sum(lost for lost, *_ in found) <= 1, found


def test_nothing_wrong_is_found_where_nothing_is_hidden() -> None:
    """That all masses are off by a share cannot be seen: the equation is homogeneous in masses and coefficients."""
    result = diagnose(draw(None, "strong").dataset, jobs=1)
    assert result.verdict == "nothing_wrong", (result.message, result.p_wrong)
    assert result.causes == ()
    assert result.gain is not None
    assert result.gain.extended == result.gain.nominal
    assert "coefficients hide" in result.undetectable["mass_error"]
    raw = json.loads(json.dumps(result.to_dict()))["isolability"]
    assert {"clock", "camera_scale", "servo_dynamics"} <= set(raw["mechanisms"])
    assert raw["units"] == list(result.isolability.units)
    told = np.isfinite(result.isolability.sizes)
    assert [[size is not None for size in row] for row in raw["sizes"]] == told.tolist()
    sizes = np.array(raw["sizes"], dtype=float)
    np.testing.assert_allclose(sizes[told], np.array(result.isolability.sizes)[told])


@pytest.mark.slow
def test_false_alarms_on_null_data_are_as_rare_as_stated() -> None:
    results = [diagnose(draw(None, "middling", number).dataset, jobs=2) for number in range(40)]
    alarms = sum(result.verdict != "nothing_wrong" for result in results)
    assert alarms <= 4, alarms  # 2 % of 40; five or more would come once in 900 times
    assert np.median([result.p_wrong for result in results]) > 0.2
