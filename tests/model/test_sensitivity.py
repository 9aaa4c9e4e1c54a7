"""Sensitivities from the compiled kernel against differences of high order of whole predictions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import Effect, find
from mjfish.effects.effect import Values
from mjfish.effects.mechanism import Domain
from mjfish.fish import Fish
from mjfish.hydro.load import load
from mjfish.model import Model
from mjfish.model.sensitivity import one_sided, sensitivities
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

#: Away from every bound; the Munk moment and a bent drag in the water.
VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
INSIDE = {
    "time_offset": {"offset": 0.013},
    "trim_moment": {"constant": 0.01, "square": 0.02},
    "clock_rate": {"error": 0.013},
    "servo_lag": {"time_constant": 0.03},
    "ambient_current": {"x": 0.04, "y": -0.03, "held": 0.7},
    "reynolds_drag": {"friction": 1.5, "pressure": 0.7},
    "tail_compliance": {"compliance": 0.3, "damping": 0.03},
    "munk_moment": {"kappa": 0.6},
}
#: Further causes, each alone, with numbers that keep it smooth: no joint is at its limit.
ALONE = {
    "power_drag": {"friction": 0.3, "pressure": -0.2},
    "whole_speed_drag": {"friction": 0.5, "pressure": 0.6},
    "exponential_drag": {"friction": 3.0, "pressure": 2.0, "reynolds": 25.0},
    "stream_lift": {"slope": 0.8},
    "body_lift": {"slope": 0.4},
    "axial_momentum": {"share": 0.6},
    "edge_momentum": {"share": 0.4},
    "added_mass_memory": {"share": 0.5, "time": 0.12},
    "keulegan_carpenter_drag": {"power": 0.3},
    "roll_loss": {"square": 1.0, "frequency": 9.0, "damping": 0.3, "inertial": 0.6},
    "sheared_current": {"x": 0.04, "y": -0.03, "held": 0.7, "shear_x": 0.2, "shear_y": -0.1},
    "servo_second_order": {"time": 0.02, "damping": 0.6},
    "servo_delay": {"time": 0.021},
    "servo_limited_lag": {"slowness": 0.1, "time": 0.006},
    "tail_hardening": {"compliance": 0.3, "damping": 0.03, "hardening": 20.0},
    "tail_law": {"compliance": 0.3, "damping": 0.03, "quadratic": -4.0, "hardening": 20.0},
    "added_mass_amplitude": {"loss": 0.4, "half": 4.0},
    "added_mass_law": {f"knot_{k}": g for k, g in enumerate((0.2, -0.3, 0.1, -0.5, -0.2, 0.3))},
    "wake_kernel": {"drag": 0.3, "late_drag": -0.2, "mass": 0.5, "late_mass": 0.4, "time": 0.05, "late_time": 0.3},
    "lift": {
        "fin_1": 0.6, "fin_2": -0.3, "fin_3": 0.2, "fin_normal": 0.2, "place": 0.3, "downwash": 0.7,
        "body_1": 0.3, "body_normal": 0.2, "body_place": 0.4, "body_downwash": 0.6,
    },
    "reactive_force": {"munk_body": 0.5, "munk_tail": -0.3, "axial": 0.4, "edge": 0.3},
    "servo_dynamics": {"time": 0.015, "delay": 0.011, "slowness": 0.1, "damping": 0.8, "catch_up": 120.0},
    "drag_law": {
        "whole_across": 0.3, "whole_along": 0.5, "height": 0.4,
        "across_0": 0.2, "across_1": 0.5, "across_2": 0.1, "across_3": -0.2, "across_4": 0.1, "across_5": 0.4,
        "across_6": 0.3, "along_0": -0.3, "along_1": 0.2, "along_2": 0.4, "along_3": 0.1, "along_4": -0.2,
        "along_5": 0.1,
    },
}  # fmt: skip
#: Central differences of eighth order.
EIGHTH = ((1, 0.8), (2, -0.2), (3, 4.0 / 105.0), (4, -1.0 / 280.0))


def _trial(mode: str, seconds: float, **fields: Any) -> Trial:
    time = np.arange(round(50 * seconds) + 1) / 50.0
    return Trial(mode, None, time, np.zeros((len(time), 3)), drive=modes.drive(mode), **fields)


def _difference(function: Callable[[float], FloatArray], at: float, step: float) -> FloatArray:
    total = sum(w * (function(at + k * step) - function(at - k * step)) for k, w in EIGHTH)
    return np.asarray(total) / step


def _agree(exact: FloatArray, expected: FloatArray, tolerance: float = 1e-7) -> None:
    worst = np.abs(exact - expected).max(axis=0) / np.maximum(np.abs(expected).max(axis=0), 1e-300)
    assert worst.max() < tolerance, worst


def _check(
    model: Model, trial: Trial, values: dict[str, float], name: str, step: float, tolerance: float = 1e-7
) -> None:
    exact = sensitivities(model, trial, values, [name])[:, :, 0]
    predicted = lambda value: model.predict(trial, {**values, name: value}).velocity  # noqa: E731
    apart = np.ones(len(trial.time), dtype=bool)
    for segment in trial.drive:  # at the start and at a step of the drive a prediction has a kink in time
        apart &= np.abs(trial.time - segment.start) > 0.01
    _agree(exact[apart], _difference(predicted, values[name], step)[apart], tolerance)


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_coefficients(pike: Fish, name: str) -> None:
    """Through a start, many changes of sign of the drag, and the jump of a change of frequency."""
    _check(Model(pike), _trial("v5-v1", 6.2), VALUES, name, 1e-3 * VALUES[name])


def test_many_roots_of_the_drag_lie_within_links(pike: Fish) -> None:
    """The test above is one of changing signs: most instants have a link whose drag changes sign along it."""
    rollout = Model(pike).predict(_trial("v5-v1", 6.2), VALUES).rollout
    head = pike.links[0].length
    v, w = rollout.state[:, 0, 1], rollout.state[:, 0, 2]
    assert np.mean(v * (v - w * head) < 0.0) > 0.3  # forward frame: the nose moves at v, the neck at v - w head


@pytest.mark.parametrize(
    ("effect", "short"), [(effect, short) for effect, values in INSIDE.items() for short in values]
)
def test_parameters_of_every_catalogued_effect(pike: Fish, effect: str, short: str) -> None:
    one = find(effect)
    model = Model(pike, (one,))
    values = VALUES | {f"{effect}.{key}": value for key, value in INSIDE[effect].items()}
    trial = _trial("v1-t2", 6.2)
    _check(model, trial, values, f"{effect}.{short}", 2e-4 * one.declaration(short).scale)


@pytest.mark.parametrize("effect", ALONE)
def test_all_parameters_of_one_effect_at_once(pike: Fish, effect: str) -> None:
    """Exact tangents of every parameter against differences of eighth order, over a start.

    Less exact where a difference goes over kinks: the corner of a rate limit, the knots of a curve, a power at rest;
    and by hidden states that begin with zero. A load without a gradient is derived by differences with a step of 2e-8.
    """
    rough = {"power_drag": 1e-6, "drag_law": 1e-4, "servo_limited_lag": 1e-2, "servo_dynamics": 1e-2}
    rough |= {"keulegan_carpenter_drag": 2e-6, "roll_loss": 1e-7, "tail_law": 1e-6}
    rough |= {"added_mass_amplitude": 2e-6, "added_mass_law": 1e-5, "wake_kernel": 1e-7}
    one = find(effect)
    model, trial = Model(pike, (one,)), _trial("v3-t1", 1.6)
    values = VALUES | {f"{effect}.{key}": value for key, value in ALONE[effect].items()}
    names = [p.name for p in model.effects[0].parameters]
    assert set(values) == {*VALUES, *names}
    exact = sensitivities(model, trial, values, names)
    for k, p in enumerate(model.effects[0].parameters):
        predicted = lambda value, name=p.name: model.predict(trial, {**values, name: value}).velocity  # noqa: E731
        expected = _difference(predicted, values[p.name], 2e-3 * p.scale)
        away = trial.time > 0.01
        plain = 1e-8 if one.load is None or one.load.slopes is not None else 5e-8
        limit = rough.get(effect, plain) if p.short == "slowness" or not effect.startswith("servo") else 1e-8
        assert np.abs(expected).max() * p.scale > 1e-6
        _agree(exact[away, :, k], expected[away], limit)


@pytest.mark.parametrize("name", ["munk_moment.kappa", "ambient_current.x", "time_offset.offset"])
def test_at_the_null_value_of_an_effect(pike: Fish, name: str) -> None:
    """Where the effect does nothing, and none of its hooks would be called."""
    group, _, short = name.partition(".")
    one = find(group)
    values = VALUES | {p.name: p.default for p in one.parameters}
    _check(Model(pike, (one,)), _trial("v3-t1", 6.0), values, name, 5e-5 * one.declaration(short).scale)


@pytest.mark.parametrize(
    "name",
    [
        "power_drag.pressure", "axial_momentum.share", "edge_momentum.share", "added_mass_memory.share",
        "drag_law.across_2", "drag_law.along_4", "lift.fin_1", "lift.body_normal", "reactive_force.munk_tail",
        "added_mass_amplitude.loss", "added_mass_law.knot_3", "wake_kernel.late_drag", "wake_kernel.mass",
    ],
)  # fmt: skip
def test_a_load_of_either_sign_at_its_null_value(pike: Fish, name: str) -> None:
    """A load that exerts nothing there is derived to one side or by its own gradient: 1e-5 of the derivative."""
    model = Model(pike, (find(name.partition(".")[0]),))
    one = next(p for p in model.parameters if p.name == name)
    values = VALUES | {p.name: p.default for p in model.effects[0].parameters}
    _check(model, _trial("v1", 1.6), values, name, 2e-3 * one.scale, 1e-5)


def test_a_load_at_the_null_value_of_its_amplitude(pike: Fish) -> None:
    """It is not called there by a prediction; its sensitivity is that of a small amplitude, on one side."""
    model = Model(pike, (find("reynolds_drag"),))
    values = VALUES | {"reynolds_drag.friction": 0.0, "reynolds_drag.pressure": 0.0}
    trial = _trial("v1", 3.0)
    exact = sensitivities(model, trial, values, ["reynolds_drag.friction"])[:, :, 0]
    at = lambda a: model.predict(trial, {**values, "reynolds_drag.friction": a}).velocity  # noqa: E731
    h = 0.01
    _agree(exact, (-25.0 * at(0.0) + 48.0 * at(h) - 36.0 * at(2 * h) + 16.0 * at(3 * h) - 3.0 * at(4 * h)) / (12.0 * h))


def test_coefficients_with_every_effect_at_work(pike: Fish) -> None:
    """A tangent goes through loads, an elastic tail, a lag, a shifted clock and a reading that turns with the yaw."""
    effects = tuple(find(name) for name in INSIDE)
    values = VALUES | {f"{name}.{key}": value for name, one in INSIDE.items() for key, value in one.items()}
    model = Model(pike, effects)
    for name in (
        "c_m.tail",
        "c_d.body",
        "munk_moment.kappa",
        "ambient_current.y",
        "ambient_current.held",
        "servo_lag.time_constant",
    ):
        _check(model, _trial("v3-t1", 5.6), values, name, 1e-5 * abs(values[name]))


@pytest.mark.parametrize("channel", ["surge", "sway", "yaw_rate"])
def test_velocity_at_the_start(pike: Fish, channel: str) -> None:
    model, trial = Model(pike), _trial("v3", 2.0)
    start = np.array([0.2, 0.05, -0.3])
    index = ("surge", "sway", "yaw_rate").index(channel)

    def predicted(value: float) -> FloatArray:
        moved = start.copy()
        moved[index] = value
        return model.predict(trial, VALUES, velocity=moved).velocity

    exact = sensitivities(model, trial, VALUES, [f"start.{channel}"], velocity=start)[:, :, 0]
    _agree(exact, _difference(predicted, float(start[index]), 1e-4))


def test_offset_of_the_clock(pike: Fish) -> None:
    """The derivative of the interpolation between steps, read where the samples are."""
    model, trial = Model(pike), _trial("v3", 2.0)
    exact = sensitivities(model, trial, VALUES, ["clock.offset"], offset=0.0012)[:, :, 0]
    predicted = lambda offset: model.predict(trial, VALUES, offset=offset).velocity  # noqa: E731
    _agree(exact, _difference(predicted, 0.0012, 1e-5), 1e-7)


class _Own(Effect):
    """A user's load, with everything a load may read."""

    name: ClassVar[str] = "own"
    domain: ClassVar[Domain] = "water"
    summary: ClassVar[str] = "sum"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("own.size", "-", 0.0, -1.0, 1.0, 0.0, 0.1),)
    source: ClassVar[str] = "none"
    signature: ClassVar[str] = "none"
    confirm: ClassVar[str] = "none"

    @staticmethod
    @load
    def load(link: Any, parameters: Any) -> tuple[float, float, float]:
        """Depend on coefficients, velocity and strips, smoothly."""
        push = parameters[0] * link.c_d * link.strip_height[3] * link.u
        return push * link.v, push * link.w, 0.1 * push * link.u * link.c_m


class _Wider(_Own):
    """A body that changes the sections the load reads."""

    name: ClassVar[str] = "wider"
    domain: ClassVar[Domain] = "body"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("wider.share", "-", 0.0, -0.5, 0.5, 0.0, 0.05),)
    load: ClassVar[None] = None  # type: ignore[assignment]

    def body(self, fish: Fish, values: Values) -> Fish:
        """Scale every height."""
        factor = 1.0 + values["share"]
        sections = tuple(s.model_copy(update={"height": tuple(factor * h for h in s.height)}) for s in fish.sections)
        return fish.model_copy(update={"sections": sections})


def test_a_users_load_and_a_users_body(pike: Fish) -> None:
    """A change of the outline moves every table of moments and what the load reads of it."""
    model = Model(pike, (_Own(), _Wider()))
    values = VALUES | {"own.size": 0.3, "wider.share": 0.1}
    for name in ("own.size", "wider.share", "c_d.tail", "c_m.head"):
        _check(model, _trial("v1", 2.0), values, name, 1e-3 * abs(values[name]))


def test_the_real_part_is_the_prediction_and_a_diverged_rollout_has_none(pike: Fish) -> None:
    model, trial = Model(pike), _trial("v1", 1.0)
    wild = VALUES | {"c_d.tail": -400.0}
    assert model.predict(trial, wild).status == "diverged"
    assert np.isnan(sensitivities(model, trial, wild, ["c_d.tail"])[-1]).all()
    assert sensitivities(model, trial, VALUES, []).shape == (51, 3, 0)


def test_one_sided_parameters_are_known(pike: Fish) -> None:
    """A servo without lag and a rigid tail are other models; drag that may only rise is not."""
    model = Model(pike, tuple(find(name) for name in INSIDE))
    assert one_sided(model, "servo_lag.time_constant", 0.0)
    assert one_sided(model, "tail_compliance.compliance", 0.0)
    assert not one_sided(model, "servo_lag.time_constant", 0.02)
    assert not one_sided(model, "reynolds_drag.friction", 0.0)
    assert not one_sided(model, "c_m.head", 0.0)
