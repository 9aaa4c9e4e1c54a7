"""Exact sensitivities of a prediction to every parameter: coefficients, effects, start velocities, clocks.

The rollout itself is derived exactly (`mjfish.ode.tangent`). What comes before and after it, the hooks of effects, is
cheap Python that may be a user's own: its derivatives are central differences of sixth order of the hooks alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mjfish import ode
from mjfish.arrays import FloatArray
from mjfish.effects.effect import Effect
from mjfish.frames import CHANNELS
from mjfish.hydro.link import column
from mjfish.hydro.load import PARAMETERS
from mjfish.hydro.load_tangent import TINY
from mjfish.model import Model, Prepared, headed, joint_motion
from mjfish.ode.rollout import Rollout, tail_of
from mjfish.ode.tangent import Direction, numbers_of, simulate_along
from mjfish.parameter import Parameter
from mjfish.trial import Trial

#: Step of a difference, in units of the parameter's scale.
_STEP = 1e-2
_SIXTH = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))


def sensitivities(
    model: Model,
    trial: Trial,
    values: Mapping[str, float],
    names: Sequence[str],
    *,
    velocity: FloatArray | None = None,
    offset: float = 0.0,
) -> FloatArray:
    """Return the derivative of the predicted velocities by parameters.

    Args:
        model, trial, values, velocity, offset: as in `mjfish.model.Model.predict`.
        names: parameters of the model; ``start.surge``, ``start.sway``, ``start.yaw_rate`` of the velocity at the start
            and ``clock.offset`` of the clock. An effect may be at its null value, but where its hooks of drive or body
            act on one side of it only (`one_sided`) it has no derivative there.

    Returns:
        (n, 3, k) at the trial's times; NaN after a divergence.
    """
    if not names:
        return np.zeros((len(trial.time), len(CHANNELS), 0))
    return np.stack([_one(model, trial, values, name, velocity, offset) for name in names], axis=2)


def one_sided(model: Model, name: str, value: float) -> bool:
    """Return whether a parameter is at a bound where the model changes its form: a servo without lag, a rigid tail."""
    effect = _owner(model, name)
    if effect is None or not (_overrides(effect, "drive") or _overrides(effect, "body")):
        return False
    p = effect.declaration(name.partition(".")[2])
    return p.default == p.low and value <= p.low + 3.0 * _STEP * p.scale


def _one(
    model: Model, trial: Trial, values: Mapping[str, float], name: str, velocity: FloatArray | None, offset: float
) -> FloatArray:
    effect = _owner(model, name)
    run = model.prepare(trial, values, offset=offset, keep=() if effect is None else (effect.name,))
    direction, rate_of_time = _direction(model, trial, values, name, run, offset)
    if direction is None:
        rollout = ode.simulate(
            run.fish, run.motion, values=run.coefficients, velocity=velocity, coriolis=model.coriolis, loads=run.loads
        )
    else:
        rollout = simulate_along(
            run.fish, run.motion, direction, values=run.coefficients, velocity=velocity, coriolis=model.coriolis,
            loads=run.loads,
        )  # fmt: skip
    return _read(model, trial, values, name, run, rollout, rate_of_time)


def _owner(model: Model, name: str) -> Effect | None:
    group = name.partition(".")[0]
    return next((effect for effect in model.effects if effect.name == group), None)


def _overrides(effect: Effect, hook: str) -> bool:
    return getattr(type(effect), hook) is not getattr(Effect, hook)


def _direction(
    model: Model, trial: Trial, values: Mapping[str, float], name: str, run: Prepared, offset: float
) -> tuple[Direction | None, FloatArray]:
    """Return what the rollout is derived by, None where nothing moves it, and the rate (n,) of the times of reading."""
    still = np.zeros(len(trial.time))
    kind, _, short = name.partition(".")
    if kind == "start":
        return Direction(velocity=np.eye(len(CHANNELS))[CHANNELS.index(short)]), still
    if name == "clock.offset":
        return None, still + 1.0
    effect = _owner(model, name)
    if effect is None:
        rows = np.zeros_like(numbers_of(run.fish))
        rows[[link.group == short for link in run.fish.links], column(kind)] = 1.0
        return Direction(links=rows), still
    p = effect.declaration(short)

    def vary(part: Callable[[Prepared], FloatArray]) -> FloatArray:
        return difference(
            lambda value: part(model.prepare(trial, {**values, name: value}, offset=offset, keep=(effect.name,))),
            p, values[name],
        )  # fmt: skip

    links: FloatArray | None = None
    tail: FloatArray | None = None
    motion: FloatArray | None = None
    loads: FloatArray | None = None
    if _overrides(effect, "body"):
        links = vary(lambda one: numbers_of(one.fish, one.coefficients))
        tail = vary(lambda one: tail_of(one.fish))
    if _overrides(effect, "drive") and trial.joint_angle is None:
        motion = vary(lambda one: _moves(model, trial, one, run.step))
    if effect.load is not None:
        loads = np.zeros((len(run.loads), PARAMETERS))
        row = [one.load for one, _ in run.active if one.load is not None].index(effect.load)
        loads[row, [own.short for own in effect.parameters].index(short)] = 1.0
    when = vary(lambda one: one.time) if _overrides(effect, "clock") else still
    if all(part is None for part in (links, tail, motion, loads)):
        return None, when
    return Direction(links=links, tail=tail, motion=motion, loads=loads), when


def _moves(model: Model, trial: Trial, run: Prepared, step: float) -> FloatArray:
    """Return angle, rate and acceleration (3, n, 3, joints) on the grid of another step."""
    servos = tuple((effect, tuple(own.items())) for effect, own in run.active if effect.family == "drive")
    motion = joint_motion(model.fish.cpg, trial, servos, step)
    return np.stack([motion.angle, motion.rate, motion.acceleration])


def _read(
    model: Model,
    trial: Trial,
    values: Mapping[str, float],
    name: str,
    run: Prepared,
    rollout: Rollout,
    rate: FloatArray,
) -> FloatArray:
    """Return the derivative (n, 3) of what the camera reads of a complex rollout."""
    end = run.motion.time[-1]
    at = np.where(run.time < end, run.time + 1j * TINY * rate, end)
    state = headed(rollout.at(at), trial)
    real = np.ascontiguousarray(state.real)
    along = np.where(np.isnan(real), np.nan, state.imag / TINY)
    readers = [(effect, own) for effect, own in run.active if _overrides(effect, "reading")]
    if not readers:
        return np.asarray(along[:, :3])
    owner = _owner(model, name)
    p = _declared(model, name)

    def seen(shift: float) -> FloatArray:
        moved = real + shift * along
        for effect, own in readers:
            here = {**own, p.short: own[p.short] + shift} if effect is owner else own
            moved = effect.reading(moved.copy(), here, trial)
        return moved[:, :3]

    return difference(seen, p, 0.0)


def _declared(model: Model, name: str) -> Parameter:
    for p in model.parameters:
        if p.name == name:
            return p
    scale = 0.005 if name == "clock.offset" else 0.01
    return Parameter(name, "-", 0.0, -1.0, 1.0, 0.0, scale)


def difference(function: Callable[[float], FloatArray], p: Parameter, value: float) -> FloatArray:
    """Return the derivative of `function` at `value` by the central difference of sixth order.

    Its step is a hundredth of the parameter's scale, less where the bound of a null value is nearer.
    """
    h = _STEP * p.scale
    if p.default == p.low and value > p.low:
        h = min(h, (value - p.low) / 4.0)
    total = sum(weight * (function(value + k * h) - function(value - k * h)) for k, weight in _SIXTH)
    return np.asarray(total) / h
