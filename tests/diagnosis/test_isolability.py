"""From which size a mechanism is told from another one: against formulas, and against draws of a linear problem."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from diagnosed import diagnosis, page
from hidden_cases import draw

import mjfish
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.isolability import Isolability, isolability, isolated
from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray

SCALE, POINT, REACTIVE = (find(name) for name in ("velocity_scale", "marker_offset", "reactive_force"))
AXIAL = find("axial_momentum")
UNIT = SCALE.parameters[0].scale


def _isolated(columns: FloatArray, *effects: mjfish.Effect) -> Isolability:
    return isolated(columns.T @ columns, np.sum(columns**2, axis=0), effects)


def _columns(seed: int, count: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((60, count))


def test_beside_an_orthogonal_mechanism_the_size_is_the_minimum_detectable_one() -> None:
    columns = np.linalg.qr(_columns(0, 3))[0] * [5.0, 1.0, 2.0]
    found = _isolated(columns, SCALE, POINT)
    assert found.mechanisms == ("camera_scale", "tracked_point")
    assert found.amplitudes == ("velocity_scale.error", "marker_offset.across")
    np.testing.assert_allclose(found.sizes[0], np.sqrt(18.0) / 5.0 * UNIT)
    np.testing.assert_allclose(found.ratios, 1.0)


def test_a_mechanism_within_the_span_of_another_is_never_told_and_not_the_other_way_round() -> None:
    columns = _columns(1, 3)
    columns[:, 0] = columns[:, 1:] @ [2.0, -1.0]
    found = _isolated(columns, SCALE, POINT)
    assert found.sizes[0][1] == np.inf
    assert np.isfinite(found.sizes[0][0])
    assert np.isfinite(found.sizes[1][0])


def test_what_the_coefficients_hide_is_neither_seen_nor_hides_another() -> None:
    """What is left of it is rounding, whose direction means nothing."""
    columns = _columns(2, 3)
    columns[:, 1:] *= 1e-9
    found = isolated(columns.T @ columns, np.array([60.0, 60.0, 60.0]), (SCALE, POINT))
    assert found.sizes[0][1] == found.sizes[0][0]
    assert found.sizes[1] == (np.inf, np.inf)
    assert found.hardest(3) == [(0, 1)]


def test_the_size_shows_with_90_percent_power_in_draws() -> None:
    """Two-sided at 2.99 sigma, the level of one of twenty causes: the other mechanism is fitted beside it."""
    columns = _columns(3, 3)
    columns[:, 0] += 0.7 * columns[:, 2]
    size = _isolated(columns, SCALE, POINT).sizes[0][1] / UNIT
    noise = np.random.default_rng(4).standard_normal((60, 20000))
    estimate = np.linalg.lstsq(columns, size * columns[:, :1] + noise, rcond=None)[0][0]
    spread = np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0])
    assert np.mean(np.abs(estimate / spread) > 2.99) == pytest.approx(0.9, abs=0.015)


def test_a_learned_form_hides_what_its_prior_lets_it_imitate() -> None:
    """Drawn from its prior, it is noise of the covariance L S^-1 L': the information of k under it is I_kl."""
    columns = 3.0 * _columns(5, 6)
    columns[:, 0] += columns[:, 2]
    found = _isolated(columns, SCALE, AXIAL, REACTIVE)
    assert found.amplitudes[1] == "axial_momentum.share"
    per_unit = columns[:, 2:] / [p.scale for p in REACTIVE.parameters]  # the prior has a standard deviation of one
    k = columns[:, 0]
    information = k @ np.linalg.solve(np.eye(60) + per_unit @ per_unit.T, k)
    assert found.sizes[0][1] == pytest.approx(np.sqrt(18.0 / information) * UNIT)


def test_of_a_diagnosis_the_diagonal_is_the_minimum_detectable_effect_and_clocks_are_hidden_by_servos() -> None:
    dataset = draw("com_offset", "weak", trials=4).dataset
    problem = Problem(Model(dataset.fish), dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    formulas = [find(name) for name in ("time_offset", "servo_delay", "velocity_scale", "reynolds_drag")]
    evidence = gather(problem, fit(problem), formulas)
    found = isolability(evidence, [find("drag_law")])
    assert found.mechanisms == ("clock", "camera_scale", "servo_dynamics", "drag_law")
    for k, name in enumerate(("time_offset", "velocity_scale")):
        (visible,) = evidence.minimum_detectable(name).values()
        assert found.sizes[k][k] == pytest.approx(visible)
    assert {(0, 2), (2, 0)} == set(found.hardest(2))
    assert np.all(found.ratios >= 1.0 - 1e-9)
    assert not np.allclose(found.ratios, found.ratios.T)
    assert found.sizes[2][2] == pytest.approx(found.sizes[0][0], rel=0.3)  # both are a delay
    beside_formula = isolability(evidence).ratios
    assert beside_formula[1, 3] < found.ratios[1, 3]  # one law against a curve


def test_in_json_a_size_that_is_not_told_is_null() -> None:
    raw = json.loads(json.dumps(diagnosis().to_dict()))["isolability"]
    assert raw.keys() == {"mechanisms", "amplitudes", "units", "sizes"}
    assert raw["sizes"][0] == [8e-5, 1.2e-3, 8.2e-5]
    assert raw["sizes"][2] == [None, None, None]


def test_the_report_has_the_ratios_and_how_much_is_hidden() -> None:
    html = page()
    table = html[html.index('<table class="isolability">') :]
    table = table[: table.index("</table>")]
    cells = re.findall(r'--hidden:(\d+)%" title="([^"]*)">([^<]*)<', table)
    assert cells == [
        ("100", "clock is told from servo_dynamics from 0.0012 s on", "15"),
        ("5", "clock is told from walls from 8.2 × 10⁻⁵ s on", "1.0"),
        ("96", "servo_dynamics is told from clock from 0.00040 s on", "5.0"),
        ("0", "servo_dynamics is told from walls from 8.0 × 10⁻⁵ s on", "1.0"),
    ]
    assert "a refit of the coefficients hides all of it" in table
