"""Exact sensitivities of a prediction to every parameter: coefficients, effects, start velocities, clocks.

The rollout itself is derived exactly, in all directions at once (`mjfish.ode.tangents`). What comes before and after
it, the hooks of effects, is cheap Python that may be a user's own: its derivatives are central differences of the hooks
alone.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.data import Sensor, Trial
from mjfish.data.columns import POSE
from mjfish.drive.motion import JointMotion
from mjfish.drive.walk import along_mode, walked
from mjfish.effects.effect import Effect
from mjfish.fish import Cpg, Fish
from mjfish.fish.frames import CHANNELS
from mjfish.hydro.link import NUMBERS, Same, column, numbers_of
from mjfish.hydro.load import PARAMETERS
from mjfish.model.model import (
    Model,
    Prepared,
    Servos,
    beginning,
    built,
    driven,
    headed,
    joint_motion,
    numbered,
    pose_of,
    requested_motion,
    servos_of,
)
from mjfish.model.sensing import Camera, Moments, distinct
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.numerics.sized_cache import sized_cache
from mjfish.ode.equation import STATES, TAIL, tail_of
from mjfish.ode.rollout import Conditions, Rollout
from mjfish.ode.tangents import Direction, simulate_tangents
from mjfish.parameters import Parameter

#: Step of a central difference, in units of the parameter's scale.
_STEP = 4e-5
#: Distance from a bound, in the same units, at which a parameter is on it.
_ON_BOUND = 1.5e-3
#: Scale of frequency [Hz] and phase [rad] of a wave.
_WAVE_SCALE = 0.05
#: Most that anything of a run is moved [m, m/s, rad, ...] by the differences of readings along a direction.
_MOVED = 1e-6
#: Samples whose rates are turned at once: what is made on the way takes 10 MB.
_STRETCH = 8192
#: Hooks of effects that say what a camera makes of a run.
_FILMED = ("clock", "displacement", "camera")


def sensitivities(
    model: Model,
    trial: Trial,
    values: Mapping[str, float],
    names: Sequence[str],
    *,
    velocity: FloatArray | None = None,
    offset: float = 0.0,
) -> FloatArray:
    """Return the derivative (n, 3, k) of the predicted velocities by parameters; see `with_sensors`."""
    return with_sensors(model, replace(trial, sensors=()), values, names, velocity=velocity, offset=offset)[0]


def with_sensors(
    model: Model,
    trial: Trial,
    values: Mapping[str, float],
    names: Sequence[str],
    *,
    velocity: FloatArray | None = None,
    offset: float = 0.0,
    pose: FloatArray | None = None,
    sensor_offsets: Mapping[str, float] | None = None,
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Return the derivatives of the predicted velocities, and of what each sensor reads, by parameters.

    Args:
        model, trial, values, velocity, offset, pose, sensor_offsets: as in `mjfish.model.Model.predict`.
        names: parameters of the model; ``start.surge``, ``start.sway``, ``start.yaw_rate`` of the velocity at the
            start, ``start.x``, ``start.y``, ``start.yaw`` of the pose there; ``clock.offset`` of the clock, and that of
            a sensor (`mjfish.data.Sensor.clock`); ``wave.frequency``, ``wave.phase`` (mid-record) and ``wave.scale`` of
            a wave, the last relative to the scale that it has; ``walk.0`` and so on of a walk. An effect may be at its
            null value, but where its hooks of drive or body act on one side of it only (`one_sided`) it has no
            derivative there.

    Returns:
        (n, 3, k) at the trial's times, 0 where sensors alone measured, and (m, c, k) at those of each sensor; NaN
        after a divergence.
    """
    run = model.prepare(trial, values, velocity=velocity, offset=offset)
    acting = [effect for effect, _ in run.active]
    groups = {name.partition(".")[0] for name in names} - {effect.name for effect in acting}
    inactive = [owner for owner in model.effects if owner.name in groups and owner.load is not None]
    at = _At(
        model,
        trial,
        values,
        velocity,
        offset,
        run,
        [effect.name for effect in (*acting, *inactive) if effect.load is not None],
    )
    directions = [_direction(at, name) for name in names]
    late, camera = sensor_offsets or {}, Camera(trial, run.active)
    labels = [sensor.time + late.get(sensor.name, 0.0) for sensor in trial.sensors]
    clocks, which = distinct([camera.clocked(s, time) for s, time in zip(trial.sensors, labels, strict=True)])
    compared = trial.measured.any() or not trial.sensors
    clocks = [run.time if compared else run.time[:0], *clocks]
    times = np.minimum(np.concatenate(clocks), run.motion.time[-1])
    rollout, every = simulate_tangents(
        run.fish, run.motion, [direction or Direction() for direction, _ in directions], times,
        conditions=Conditions(
            run.coefficients, run.velocity, pose_of(trial) if pose is None else pose, model.coriolis, run.loads
        ),
        inactive=[
            (effect.load, [*effect.short_values(values).values(), *effect.constants(trial)])
            for effect in inactive
            if effect.load is not None
        ],
        with_rates=not all(map(camera.pointwise, trial.sensors)),
    )  # fmt: skip
    along, *beside = np.split(every, np.cumsum([len(clock) for clock in clocks])[:-1])
    ways = [direction for direction, _ in directions]
    here = [camera.moments(run.fish, rollout, run.motion, clock) for clock in clocks[1:]]
    there = [_along(one, block, ways, run.motion) for one, block in zip(here, beside, strict=True)]
    filmed = functools.cache(lambda k, link, station: _filmed(camera, link, station, here[k], there[k]))
    seen = []
    for sensor, label, k in zip(trial.sensors, labels, which, strict=True):
        if camera.pointwise(sensor):  # place and heading are mostly those of one point
            channels = slice(2) if sensor.kind == "position" else slice(2, 3)
            found = filmed(k, sensor.link, sensor.station)[:, channels].copy()
        else:
            found = _read_rates(camera, sensor, here[k], there[k])
        seen.append(_sensed(at, sensor, rollout, label, here[k], found, names))
    if not compared:
        return np.zeros((len(run.time), len(CHANNELS), len(names))), tuple(seen)
    along, times = along[:, :STATES], times[: len(along)]
    if any(rate is not None for _, rate in directions):
        ahead = rollout.rate_at(times) * (run.time < run.motion.time[-1])[:, None]
        for k, (_, rate) in enumerate(directions):
            if rate is not None:
                along[:, :, k] += ahead * rate[:, None]
    if trial.pose is not None:  # the heading at the first sample is the measured one, whatever moves
        along[:, 5] -= along[0, 5]
    return _read(at, lambda: headed(rollout.at(times), trial), along, names), tuple(seen)


def _filmed(camera: Camera, link: int, station: float, here: Moments, along: Moments) -> FloatArray:
    """Return the rates (m, 3, k) of place and heading of a point as the camera sees them."""
    found = np.zeros((len(here.time), 3, along.state.shape[2]))
    for first in range(0, len(found), _STRETCH):
        part = slice(first, first + _STRETCH)
        found[part] = camera.filmed_rates(link, station, here.part(part), along.part(part))
    return found


def _read_rates(camera: Camera, sensor: Sensor, here: Moments, every: Moments) -> FloatArray:
    """Return the rates (m, c, k) of what a sensor reads along all directions, by differences to one side."""
    found = np.zeros((len(here.time), len(sensor.channels), every.state.shape[2]))
    read = camera.read(sensor, here)
    for k in range(found.shape[2]):
        along = Moments(here.time, *(part[..., k] for part in (every.state, every.rate, every.angle, every.length)))
        if (most := along.largest()) > 0.0:
            by = _MOVED / most
            found[:, :, k] = (camera.read(sensor, here.moved(by, along)) - read) / by
    return found


def _sensed(
    at: _At,
    sensor: Sensor,
    rollout: Rollout,
    label: FloatArray,
    here: Moments,
    found: FloatArray,
    names: Sequence[str],
) -> FloatArray:
    """Return the derivatives (m, c, k) of what a sensor reads at the times (m,) that its samples have.

    Args:
        at, rollout, names: as in `with_sensors`.
        sensor, label: and the times that its samples have.
        here: the run at its samples.
        found: (m, c, k) how it moves with the run; overwritten.
    """
    fish, motion, camera = at.run.fish, at.run.motion, Camera(at.trial, at.run.active)

    def seen(time: FloatArray) -> Moments:
        return camera.moments(fish, rollout, motion, time)

    clock = camera.clocked(sensor, label)
    for k, name in enumerate(names):
        p, owner = _declared(at.model, name), _owner(at.model, name)
        if name == sensor.clock:
            found[:, :, k] = difference(lambda by: camera.read(sensor, seen(clock + by)), p, 0.0)
        if owner is not None and camera.sees(sensor) and any(map(owner.overrides, _FILMED)):

            def turned(value: float, owner: Effect = owner, name: str = name) -> FloatArray:
                other = Camera(at.trial, [(effect, dict(own)) for effect, own in at.acting_with(owner, (name, value))])
                return other.read(sensor, seen(other.clocked(sensor, label)) if owner.overrides("clock") else here)

            found[:, :, k] += difference(turned, p, at.values[name])
    return found


def _along(here: Moments, along: FloatArray, directions: Sequence[Direction | None], motion: JointMotion) -> Moments:
    """Return the rates of a run at some moments along all directions, the last axis.

    `along` (m, 16, k) has those of the state and of its rates; (m, 8, k) where all sensors are pointwise.
    """
    angle = np.zeros((*here.angle.shape, len(directions)))
    length = np.zeros((len(here.length), len(directions)))
    for k, direction in enumerate(directions):
        if direction is not None and direction.motion is not None:
            angle[:, :, k] = JointMotion(motion.time, *direction.motion).angle_at(here.time)
        if direction is not None and direction.links is not None:
            length[:, k] = direction.links[:, column("length")]
    return Moments(here.time, along[:, :STATES], along[:, STATES:], angle, length)


def one_sided(model: Model, name: str, value: float) -> bool:
    """Return whether a parameter is at a bound where the model changes its form: a servo without lag, a rigid tail."""
    effect = _owner(model, name)
    if effect is None or not (effect.overrides("drive") or effect.overrides("body")):
        return False
    p = effect.declaration(name.partition(".")[2])
    return not p.shape and p.default == p.low and value <= p.low + _ON_BOUND * p.scale


@dataclass(frozen=True, eq=False)
class _At:
    """Where derivatives are taken: arguments of `sensitivities`, what is simulated, whose loads are in its table."""

    model: Model
    trial: Trial
    values: Mapping[str, float]
    velocity: FloatArray | None
    offset: float
    run: Prepared
    loaded: list[str]

    @property
    def servos(self) -> Servos:
        """The effects between what the joints are asked for and what they do."""
        return servos_of(self.run.active, self.trial)

    def acting_with(self, owner: Effect | None, shift: tuple[str, float] | None = None) -> Servos:
        """Return the effects that act, and the owner of a parameter even if it does not, with one value replaced."""
        acting = {effect.name for effect, _ in self.run.active} | ({owner.name} if owner else set())
        values = self.values if shift is None else {**self.values, shift[0]: shift[1]}
        return tuple((e, tuple(e.short_values(values).items())) for e in self.model.effects if e.name in acting)


def _owner(model: Model, name: str) -> Effect | None:
    group = name.partition(".")[0]
    return next((effect for effect in model.effects if effect.name == group), None)


def _direction(at: _At, name: str) -> tuple[Direction | None, FloatArray | None]:
    """Return what the rollout is derived by and the rates (n,) of the times of reading; None where nothing moves."""
    kind, _, short = name.partition(".")
    if kind == "start" and short in POSE:
        return Direction(pose=np.eye(len(POSE))[POSE.index(short)]), None
    if kind == "start":
        return Direction(velocity=np.eye(len(CHANNELS))[CHANNELS.index(short)]), None
    if name == "clock.offset":
        return None, np.ones(len(at.trial.time))
    if any(name == sensor.clock for sensor in at.trial.sensors):
        return None, None
    if kind == "wave":
        return Direction(motion=_of_wave(Same(at.model.fish.cpg), at.trial, at.servos, short, at.run.step)), None
    if kind == "walk":
        due = joint_motion(requested_motion(at.model.fish.cpg, at.trial, at.run.step), at.servos)
        return Direction(motion=along_mode(due, at.trial.walk, int(short), level=at.trial.level_walk)), None
    effect = _owner(at.model, name)
    if effect is not None:
        return _of_effect(at, effect, name)
    if name in at.run.coefficients:
        return _of_coefficient(tuple(link.group for link in at.run.fish.links), kind, short), None
    return Direction(**_links(at, _declared(at.model, name), None)), None


def _of_effect(at: _At, effect: Effect, name: str) -> tuple[Direction | None, FloatArray | None]:
    """Return the same of a parameter of an effect."""
    p = effect.declaration(name.partition(".")[2])
    moved: dict[str, FloatArray] = {}

    def beginning_at(value: float) -> tuple[FloatArray, FloatArray]:
        kept = tuple((each, dict(own)) for each, own in at.acting_with(effect, (name, value)))
        return beginning(kept, at.trial, at.velocity, at.offset)

    if effect.overrides("start"):
        moved["velocity"] = difference(lambda value: beginning_at(value)[1], p, at.values[name])
    if effect.overrides("body"):
        moved |= _links(at, p, effect)
    if effect.overrides("drive") and effect.moves_joints(at.trial):
        servos = tuple(active for active in at.acting_with(effect) if active[0].moves_joints(at.trial))
        moved["motion"] = _of_drive(
            requested_motion(at.model.fish.cpg, at.trial, at.run.step),
            servos,
            p,
            at.values[name],
            at.trial.walk,
            at.trial.level_walk,
        )
    if effect.load is not None:
        moved["loads"] = np.zeros((len(at.loaded), PARAMETERS))
        moved["loads"][at.loaded.index(effect.name), [own.short for own in effect.parameters].index(p.short)] = 1.0
    when = difference(lambda value: beginning_at(value)[0], p, at.values[name]) if effect.overrides("clock") else None
    return Direction(**moved) if moved else None, when


@functools.lru_cache(maxsize=64)
def _of_coefficient(groups: tuple[str, ...], kind: str, group: str) -> Direction:
    rows = np.zeros((len(groups), NUMBERS))
    rows[[link_group == group for link_group in groups], column(kind)] = 1.0
    return Direction(links=rows)


def _replaced(hooked: Servos, p: Parameter, value: float) -> Servos:
    return tuple(
        (effect, tuple((short, value if effect.name == p.group and short == p.short else old) for short, old in own))
        for effect, own in hooked
    )


def _links(at: _At, p: Parameter, owner: Effect | None) -> dict[str, FloatArray]:
    """Return rates of links and tail by a parameter of an effect, or by a free number of the fish."""
    hooked = tuple(active for active in at.acting_with(owner) if active[0].overrides("body"))
    numbers = tuple((own.name, at.values.get(own.name, own.default)) for own in at.model.fish.numbers)
    rows = _of_body(Same(at.model.fish), numbers, hooked, p, at.values.get(p.name, p.default))
    return {"links": rows[:, :-TAIL], "tail": rows[0, -TAIL:]}


@functools.lru_cache(maxsize=256)
def _of_body(
    fish: Same[Fish], numbers: tuple[tuple[str, float], ...], hooked: Servos, p: Parameter, value: float
) -> FloatArray:
    """Return rates of the link records, and in TAIL more columns, in every row, of the tail; coefficients stay."""

    def rows(at_value: float) -> FloatArray:
        return _body(numbered(fish.thing, {**dict(numbers), p.name: at_value}), _replaced(hooked, p, at_value))

    return readonly(difference(rows, p, value))


def _body(fish: Fish, hooked: Servos) -> FloatArray:
    """Return the rows of the links through the hooks of effects, with TAIL more columns, in every row, of the tail."""
    made = built(fish, tuple((effect, dict(own)) for effect, own in hooked))
    numbers = numbers_of(made, fish.values)
    return np.concatenate([numbers, np.broadcast_to(tail_of(made), (len(numbers), TAIL))], axis=1)


@sized_cache(lambda rates: rates.nbytes, 0.05e9)
def _of_drive(
    asked: JointMotion, servos: Servos, p: Parameter, value: float, walk: tuple[float, ...], level: bool
) -> FloatArray:
    """Return rates of angle, rate and acceleration (3, n, 3, joints)."""

    def moves(at_value: float) -> FloatArray:
        return _stacked(walked(driven(asked, _replaced(servos, p, at_value)), walk, level=level))

    return readonly(difference(moves, p, value))


def _stacked(motion: JointMotion) -> FloatArray:
    return np.stack([motion.angle, motion.rate, motion.acceleration])


@sized_cache(lambda rates: rates.nbytes, 0.05e9)
def _of_wave(cpg: Same[Cpg | None], trial: Trial, servos: Servos, short: str, step: float) -> FloatArray:
    """Return rates of angle, rate and acceleration (3, n, 3, joints) by the frequency or the phase of a wave."""

    def moves(by: float) -> FloatArray:
        moved = {"frequency": (by, 0.0, 1.0), "phase": (0.0, by, 1.0), "scale": (0.0, 0.0, 1.0 + by)}[short]
        got = driven(requested_motion(cpg.thing, trial.waved(*moved), step), servos)
        return _stacked(walked(got, trial.walk, level=trial.level_walk))

    return readonly(difference(moves, Parameter(f"wave.{short}", "-", 0.0, -1.0, 1.0, 0.0, _WAVE_SCALE), 0.0))


def _read(at: _At, states: Callable[[], FloatArray], along: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the derivatives (n, 3, k) of what the camera reads of the states (n, 8) that move along (n, 8, k)."""
    read = along[:, :3].copy()
    state = states() if any(effect.overrides("reading") for effect in at.model.effects) else np.zeros((0, STATES))
    acting = [effect for effect, _ in at.run.active]
    for k, name in enumerate(names):
        owner = _owner(at.model, name)
        readers = [e for e in at.model.effects if (e in acting or e is owner) and e.overrides("reading")]
        if readers:
            read[:, :, k] = _seen(at, state, along[:, :, k], name, readers)
    return read


def _seen(at: _At, state: FloatArray, along: FloatArray, name: str, readers: Sequence[Effect]) -> FloatArray:
    owner, p = _owner(at.model, name), _declared(at.model, name)

    def seen(shift: float) -> FloatArray:
        moved = state + shift * along
        for effect in readers:
            own = effect.short_values(at.values)
            if effect is owner:
                own[p.short] += shift
            moved = effect.reading(moved.copy(), own, at.trial)
        return moved[:, :3]

    return difference(seen, p, 0.0)


def _declared(model: Model, name: str) -> Parameter:
    return next((p for p in model.parameters if p.name == name), None) or _undeclared(name)


@functools.lru_cache(maxsize=256)
def _undeclared(name: str) -> Parameter:
    """Return a declaration of what no model has: a clock, or where and how fast a run begins."""
    scale = 0.005 if name.endswith(("clock.offset", ".clock_offset")) else 0.01
    return Parameter(name, "-", 0.0, -1.0, 1.0, 0.0, scale)


def difference(function: Callable[[float], FloatArray], p: Parameter, value: float) -> FloatArray:
    """Return the derivative of `function` at `value` by a central difference.

    Its step is _STEP of the parameter's scale, less where the bound of a null value is nearer.
    """
    h = _STEP * p.scale
    if p.default == p.low and value > p.low:
        h = min(h, (value - p.low) / 3.0)
    return np.asarray(function(value + h) - function(value - h)) / (2.0 * h)
