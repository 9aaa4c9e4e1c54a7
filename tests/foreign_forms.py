"""Causes in forms that the catalogue does not have: mechanisms as others would write them.

They are planted in data, never fitted. A wrong form of the right mechanism must not bring in a second cause.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from mjfish.drive.motion import JointMotion
from mjfish.effects.beat_amplitude import TAU, keulegan_carpenter
from mjfish.effects.effect import Effect, Values
from mjfish.effects.mechanism import Domain
from mjfish.effects.momentum_rate import momentum_rate
from mjfish.fish import Fish
from mjfish.hydro.force import crossflow
from mjfish.hydro.load import Load, load
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

_TEXT = {"summary": "foreign", "source": "foreign", "signature": "foreign", "confirm": "foreign"}


def _size(name: str) -> tuple[Parameter, ...]:
    return (Parameter(f"{name}.size", "-", 0.0, -5.0, 5.0, 0.0, 0.1, about="size"),)


class _Foreign(Effect):
    summary: ClassVar[str] = "foreign"
    source: ClassVar[str] = "foreign"
    signature: ClassVar[str] = "foreign"
    confirm: ClassVar[str] = "foreign"


@load
def _bent(link: Any, parameters: Any) -> tuple[float, float, float]:
    across = 0.0
    moment = 0.0
    for k in range(link.strip_r.shape[0]):
        r = link.strip_r[k]
        q = link.v + link.w * r
        factor = parameters[0] * 1.5 / (1.0 + (abs(q) / 1.0) ** 2)
        share = link.strip_weight[k] * link.strip_height[k] * factor * abs(q) * q
        across += share
        moment += share * r
    along = 1.5 * parameters[0] / (1.0 + (abs(link.u) / 1.0) ** 2) * link.c_f * link.wetted * abs(link.u) * link.u
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


class BentDrag(_Foreign):
    """c (1 + 1.5 a / (1 + (V / (1 m/s))^2)): a drag crisis smeared out."""

    name: ClassVar[str] = "bent_drag"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "drag_law"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("bent_drag")
    load: ClassVar[Load | None] = _bent


@load
def _exponential(link: Any, parameters: Any) -> tuple[float, float, float]:
    across = 0.0
    moment = 0.0
    along = 0.0
    for k in range(link.strip_r.shape[0]):
        r = link.strip_r[k]
        q = link.v + link.w * r
        rise = parameters[0] * 2.0 * np.exp(-np.sqrt(q * q + link.u * link.u) * link.strip_height[k] / 0.1)
        share = link.strip_weight[k] * link.strip_height[k] * rise * abs(q) * q
        across += share
        moment += share * r
        along += link.strip_weight[k] * link.strip_perimeter[k] * rise * link.c_f * abs(link.u) * link.u
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


class ExponentialReynolds(_Foreign):
    """1 + 2 a exp(-Re / 100000), whole speed and local height."""

    name: ClassVar[str] = "exponential_reynolds"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "drag_law"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("exponential_reynolds")
    load: ClassVar[Load | None] = _exponential


@load
def _power(link: Any, parameters: Any) -> tuple[float, float, float]:
    across = 0.0
    moment = 0.0
    for k in range(link.strip_r.shape[0]):
        r = link.strip_r[k]
        q = link.v + link.w * r
        factor = (np.sqrt(q * q + link.u * link.u + 1e-8) / 0.3) ** (-0.6 * parameters[0]) - 1.0
        share = link.strip_weight[k] * link.strip_height[k] * factor * abs(q) * q
        across += share
        moment += share * r
    factor = (np.sqrt(link.u * link.u + 1e-8) / 0.3) ** (-0.4 * parameters[0]) - 1.0
    along = factor * link.c_f * link.wetted * abs(link.u) * link.u
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


class PowerOfWholeSpeed(_Foreign):
    """c_d (|V| / 0.3)^(-0.6 a), c_f (|u| / 0.3)^(-0.4 a)."""

    name: ClassVar[str] = "power_of_whole_speed"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "drag_law"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("power_of_whole_speed")
    load: ClassVar[Load | None] = _power


@load
def _stalling(link: Any, parameters: Any) -> tuple[float, float, float]:
    if link.last == 0.0:
        return 0.0, 0.0, 0.0
    u = link.u
    q = link.v + 0.5 * link.length * link.w
    angle = np.arctan2(q, abs(u))
    area = link.height_moment[128, 0]
    c = 3.0 * parameters[0] * np.sin(2.0 * angle) * (1.0 - 0.35 * np.sin(angle) ** 2)
    lift = 0.5 * link.density * area * c * (u * u + q * q)
    speed = np.sqrt(u * u + q * q) + 1e-12
    fx = lift * q / speed if u > 0.0 else -lift * q / speed
    fy = -lift * abs(u) / speed
    return fx, fy, 0.33 * link.length * fy


class StallingLift(_Foreign):
    """Lift of the fin across the stream, 3 a sin 2 alpha (1 - 0.35 sin^2 alpha), at a third of the chord."""

    name: ClassVar[str] = "stalling_lift"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "lift"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("stalling_lift")
    load: ClassVar[Load | None] = _stalling


@load
def _body(link: Any, parameters: Any) -> tuple[float, float, float]:
    if link.last == 1.0:
        return 0.0, 0.0, 0.0
    u = link.u
    q = link.v + 0.3 * link.length * link.w
    speed = np.sqrt(u * u + q * q) + 1e-12
    area = link.height_moment[128, 0]
    lift = 0.5 * link.density * area * parameters[0] * 1.2 * abs(u) * q
    fx = lift * q / speed if u > 0.0 else -lift * q / speed
    fy = -lift * abs(u) / speed
    return fx, fy, 0.3 * link.length * fy


class BodyAcrossStream(_Foreign):
    """Lift of the links of the body across the stream, 0.6 a sin 2 alpha, at 0.3 of each."""

    name: ClassVar[str] = "body_across_stream"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "lift"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("body_across_stream")
    load: ClassVar[Load | None] = _body


@load
def _munk(link: Any, parameters: Any) -> tuple[float, float, float]:
    if link.last == 1.0:
        return 0.0, 0.0, 0.0
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    return 0.0, 0.0, -parameters[0] * link.u * momentum


class MunkOfBody(_Foreign):
    """The Munk moment of all links but the last."""

    name: ClassVar[str] = "munk_of_body"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "reactive_force"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("munk_of_body")
    load: ClassVar[Load | None] = _munk


def _through(motion: JointMotion, rates: Any, start: Any) -> JointMotion:
    """Integrate a servo's own equation x' = rates(t, c, c', x) from `start(c)` and return what the joints did."""
    nodes, angle, _ = motion.half_steps()
    knots = np.concatenate([angle[:, 0], angle[-1:, 1]])
    command = CubicSpline(nodes, knots)
    joints = motion.joints
    x0 = np.concatenate(start(knots[0]))
    states = len(x0) // joints

    def f(t: float, x: FloatArray) -> FloatArray:
        return np.concatenate(rates(command(t), command(t, 1), x.reshape(states, joints)))

    solved = solve_ivp(f, (nodes[0], nodes[-1]), x0, t_eval=nodes, max_step=0.002, rtol=1e-7, atol=1e-9)
    theta = solved.y[:joints].T
    turn = np.array([f(t, x)[:joints] for t, x in zip(nodes, solved.y.T, strict=True)])
    change = CubicSpline(nodes, turn)(nodes, 1)
    shape = (len(motion.time) - 1, 3, joints)
    index = np.add.outer(2 * np.arange(shape[0]), np.arange(3))
    return JointMotion(motion.time, theta[index], turn[index], change[index])


class PlantWithInertia(_Foreign):
    """theta'' = w^2 (c - theta) - 2 z w theta', w = 35 / a, z = 0.5, from rest."""

    name: ClassVar[str] = "plant_with_inertia"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("plant_with_inertia")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return what the joints did."""
        w = 35.0 / values["size"]

        def rates(c: FloatArray, _: FloatArray, x: FloatArray) -> list[FloatArray]:
            return [x[1], w * w * (c - x[0]) - 2.0 * 0.5 * w * x[1]]

        return _through(motion, rates, lambda c: [c, 0.0 * c])


class LimitAndLag(_Foreign):
    """theta' = clip((c - theta) / 2 ms, +- 6 / a rad/s), from rest."""

    name: ClassVar[str] = "limit_and_lag"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("limit_and_lag")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return what the joints did."""
        most = 6.0 / values["size"]

        def rates(c: FloatArray, _: FloatArray, x: FloatArray) -> list[FloatArray]:
            return [np.clip((c - x[0]) / 0.002, -most, most)]

        return _through(motion, rates, lambda c: [c])


class TwoLags(_Foreign):
    """Two lags of first order, 12 a and 20 a milliseconds, and a dead time of 10 a."""

    name: ClassVar[str] = "two_lags"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("two_lags")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return what the joints did."""
        a = values["size"]

        def rates(c: FloatArray, _: FloatArray, x: FloatArray) -> list[FloatArray]:
            return [(x[1] - x[0]) / (0.02 * a), (c - x[1]) / (0.012 * a)]

        return _through(motion, rates, lambda c: [c, c])


class Sloppy(_Foreign):
    """A tail whose spring hardens strongly: h = 120 / rad^2."""

    name: ClassVar[str] = "sloppy"
    domain: ClassVar[Domain] = "body"
    mechanism: ClassVar[str] = "tail_flexibility"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("sloppy")

    def body(self, fish: Fish, values: Values) -> Fish:
        """Return the fish with such a tail."""
        return fish.model_copy(
            update={"tail_compliance": 0.4 * values["size"], "tail_damping": 0.05, "tail_hardening": 60.0}
        )


@load(memory=2, shared=True)
def _slipping(link: Any, parameters: Any) -> tuple[float, float, float, float, float]:
    across = 0.0
    moment = 0.0
    for k in range(link.strip_r.shape[0]):
        q = link.v + link.w * link.strip_r[k]
        share = link.strip_weight[k] * link.strip_height[k] * abs(q) * q
        across += share
        moment += share * link.strip_r[k]
    half = -0.5 * link.density * link.c_d
    roll, rate = link.memory[0], link.memory[1]
    lost = np.cos(parameters[0] * roll) ** 2 - 1.0
    change = 2.0 * half * across
    turn = 0.0
    if link.last == 1.0:
        turn = rate
        change += -2.0 * 0.4 * 11.0 * rate - 11.0**2 * roll
    return 0.0, lost * half * across, lost * half * moment, turn, change


class RollSlip(_Foreign):
    """phi'' + 8.8 phi' + 121 phi = 2 a (drag across), and the drag across times cos^2 phi; the camera sees no roll."""

    name: ClassVar[str] = "roll_slip"
    domain: ClassVar[Domain] = "out_of_plane"
    mechanism: ClassVar[str] = "roll"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("roll_slip")
    load: ClassVar[Load | None] = _slipping
    mujoco: ClassVar[bool] = False


@load(memory=8)
def _dipping(link: Any, parameters: Any) -> tuple[float, ...]:
    height = np.sqrt(4.0 * link.added[0] / (np.pi * link.density * link.length))
    number = keulegan_carpenter(link.memory[1], height)
    excess = -0.5 * parameters[0] * np.exp(-0.7 * np.log(number / 6.0) ** 2)
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    turning = link.c_m * (link.added[1] * link.v + link.added[2] * link.w)
    rate, a, b, c = momentum_rate(momentum, link.memory[2], link.memory[3], link.memory[4])
    turn, d, e, f = momentum_rate(turning, link.memory[5], link.memory[6], link.memory[7])
    way = link.memory[0]
    middle = link.v + 0.5 * link.length * link.w
    moved, square = middle - way / TAU, (way * way - link.memory[1]) / TAU
    return excess * link.w * momentum, -excess * rate, -excess * turn, moved, square, a, b, c, d, e, f


class DippingMass(_Foreign):
    """c_m (1 - a exp(-0.7 ln(KC / 6)^2) / 2): cylinders lose added mass about one Keulegan-Carpenter number."""

    name: ClassVar[str] = "dipping_mass"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "added_mass"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("dipping_mass")
    load: ClassVar[Load | None] = _dipping
    mujoco: ClassVar[bool] = False


@load(memory=8)
def _fading(link: Any, parameters: Any) -> tuple[float, ...]:
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    half = -0.5 * link.density * link.c_d
    f, m = half * force, half * moment
    f0, f1, f2, f3 = f - link.memory[0], f - link.memory[1], f - link.memory[2], f - link.memory[3]
    m0, m1, m2, m3 = m - link.memory[4], m - link.memory[5], m - link.memory[6], m - link.memory[7]
    share = -0.1 * parameters[0]
    late, turned = share * (f0 + f1 + f2 + f3), share * (m0 + m1 + m2 + m3)
    return 0.0, late, turned, f0 / 0.03, f1 / 0.1, f2 / 0.3, f3, m0 / 0.03, m1 / 0.1, m2 / 0.3, m3


class FadingWake(_Foreign):
    """Two fifths a of the drag across come late, spread over 0.03 to 1 s evenly in the logarithm: near a power law."""

    name: ClassVar[str] = "fading_wake"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "wake_memory"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("fading_wake")
    load: ClassVar[Load | None] = _fading
    mujoco: ClassVar[bool] = False


class CrankedServo(_Foreign):
    """theta = L sin(c / L), L = 0.75 rad / a: a crank that pulls a lever."""

    name: ClassVar[str] = "cranked_servo"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_limit"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("cranked_servo")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return what the joints did."""
        length = 0.75 / values["size"]
        sine, cosine = np.sin(motion.angle / length), np.cos(motion.angle / length)
        bent = cosine * motion.acceleration - sine / length * motion.rate**2
        return JointMotion(motion.time, length * sine, cosine * motion.rate, bent)


class LooseTail(_Foreign):
    """M = delta (1 + 12 |delta|) / (0.4 a): a tail that stiffens with its deflection, and hardly at first."""

    name: ClassVar[str] = "loose_tail"
    domain: ClassVar[Domain] = "body"
    mechanism: ClassVar[str] = "tail_flexibility"
    parameters: ClassVar[tuple[Parameter, ...]] = _size("loose_tail")

    def body(self, fish: Fish, values: Values) -> Fish:
        """Return the fish with such a tail."""
        soft = {"tail_compliance": 0.4 * values["size"], "tail_damping": 0.05, "tail_quadratic": 12.0}
        return fish.model_copy(update=soft)


def _knots(seed: int) -> FloatArray:
    """Return a random smooth curve at 12 knots an octave apart, about zero."""
    rng = np.random.default_rng(seed)
    x = np.arange(8.0)
    length = rng.uniform(1.5, 4.0)
    covariance = np.exp(-0.5 * (np.subtract.outer(x, x) / length) ** 2) + 1e-9 * np.eye(8)
    return rng.multivariate_normal(np.zeros(8), covariance)


def random_drag(seed: int) -> Effect:
    """Return drag whose c_d and c_f are random functions of the speed: Gaussian processes in its logarithm."""
    across, along = _knots(2 * seed), _knots(2 * seed + 1)

    @load
    def excess(link: Any, parameters: Any) -> tuple[float, float, float]:
        force = 0.0
        moment = 0.0
        for k in range(link.strip_r.shape[0]):
            r = link.strip_r[k]
            q = link.v + link.w * r
            g = parameters[0] * np.interp(np.log2(abs(q) / 0.6 + 1e-9) + 4.0, np.arange(8.0), across)
            share = link.strip_weight[k] * link.strip_height[k] * np.expm1(g) * abs(q) * q
            force += share
            moment += share * r
        g = parameters[0] * np.interp(np.log2(abs(link.u) / 0.6 + 1e-9) + 4.0, np.arange(8.0), along)
        friction = np.expm1(g) * link.c_f * link.wetted * abs(link.u) * link.u
        half = -0.5 * link.density
        return half * friction, half * link.c_d * force, half * link.c_d * moment

    body = {
        "name": "random_drag", "domain": "water", "mechanism": "drag_law", "parameters": _size("random_drag"),
        "load": excess,
    }  # fmt: skip
    cause: Effect = type("RandomDrag", (_Foreign,), body)()
    return cause


FOREIGN: tuple[Effect, ...] = (
    BentDrag(),
    ExponentialReynolds(),
    PowerOfWholeSpeed(),
    StallingLift(),
    BodyAcrossStream(),
    MunkOfBody(),
    PlantWithInertia(),
    LimitAndLag(),
    TwoLags(),
    Sloppy(),
    RollSlip(),
)
#: Of mechanisms whose learned form came later. They are fitted by it (tests/effects/test_learned_forms.py).
LATER: tuple[Effect, ...] = (DippingMass(), FadingWake(), CrankedServo(), LooseTail())
