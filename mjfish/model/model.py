"""The model that is fitted: a fish and the effects that extend it; a trial in, predicted measurements out."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mjfish import ode
from mjfish.data import Trial
from mjfish.drive import cpg as hopf
from mjfish.drive import measured, wave
from mjfish.drive.motion import JointMotion, cached
from mjfish.drive.walk import walked
from mjfish.effects.effect import Effect, Values
from mjfish.errors import InputError, UnknownNameError
from mjfish.errors.arguments import check
from mjfish.fish import Cpg, Fish, Link
from mjfish.fish.outline import outlines
from mjfish.hydro.link import Same
from mjfish.hydro.load import Load
from mjfish.model.sensing import Camera, distinct
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.sized_cache import sized_cache
from mjfish.ode.rollout import STEP, Coriolis, Rollout
from mjfish.parameters import Parameter

#: At both ends of measured joint angles, where a shifted clock would ask for motion that nobody saw [s].
MARGIN = 0.1
#: A CPG goes on this long behind the last sample: a clock may be that far ahead [s].
LEAD = 0.25
#: Largest product of step and fastest rate of the flexible tail; Runge-Kutta is stable below 2.8. Of shorter steps than
#: this [s] it is less in proportion: who asks for a finer step has a finer tail, too.
_STIFFNESS, _COARSE = 2.0, 0.005
#: Share of the speed of the tail that is left where the head is free to recoil and the tail gives way.
_RECOIL = 0.25
#: Octaves by which the step is shortened for it at most.
_FINEST = 5.0


#: Effects between what the joints are asked for and what they do, with their values by short names.
Servos = tuple[tuple[Effect, tuple[tuple[str, float], ...]], ...]
#: Effects that act, with their parameters by short names; loads of a run, with their numbers.
ActiveEffects = tuple[tuple[Effect, Values], ...]
LoadsOfRun = tuple[tuple[Load, tuple[float, ...]], ...]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted measurements of one trial.

    Attributes:
        velocity: (n, 3) at the trial's times; NaN after a divergence.
        status: ``ok`` or ``diverged``.
        message: why, where it is not ok.
        rollout: the rollout behind it.
        pose: (n, 3) predicted x, y [m], yaw [rad] at the trial's times; it begins as measured, or at 0.
        sensors: (m, c) what each sensor of the trial reads; NaN after a divergence.
    """

    velocity: FloatArray
    status: Literal["ok", "diverged"]
    message: str
    rollout: Rollout
    pose: FloatArray
    sensors: tuple[FloatArray, ...] = ()


@dataclass(frozen=True)
class Model:
    """A fish, extended by effects.

    Attributes:
        fish: with its nominal coefficients.
        effects: the causes that extend it, none for the nominal model.
        step: longest integration step [s].
        coriolis: form of the gyroscopic terms: ``corrected``, or ``printed`` as in [Yu2016].
        penalty_share: measured joint angles are smoothed with this share of the penalty of cross-validation, where
            their errors are allowed for.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate("pike", ["v1"], duration=2.0)
        >>> model = mjfish.Model(pool.fish)
        >>> model.predict(pool.trials[0], model.values({"c_d.tail": 1.5})).velocity.shape
        (101, 3)
    """

    fish: Fish
    effects: tuple[Effect, ...] = ()
    step: float = STEP
    coriolis: Coriolis = "corrected"
    penalty_share: float = measured.ALLOWED

    def __post_init__(self) -> None:
        """Give each effect the parameters that this fish has; refuse one that is there twice."""
        check("Model: fish", self.fish, Fish)
        check("Model: effects", self.effects, tuple[Effect, ...])
        object.__setattr__(self, "effects", tuple(effect.for_fish(self.fish) or effect for effect in self.effects))
        names = [effect.name for effect in self.effects]
        if len(set(names)) < len(names):
            raise InputError(f"effects {', '.join(names)}: one is there twice; give each once")

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients of the fish, its other free numbers, then the parameters of every effect."""
        return (*self.fish.parameters, *self.fish.numbers, *(p for effect in self.effects for p in effect.parameters))

    def extended(self, effect: Effect) -> Model:
        """Return the model with one more effect."""
        return replace(self, effects=(*self.effects, effect))

    def values(self, given: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return a value for every parameter, by default or from `given`, checked against its bounds."""
        known = {p.name: p for p in self.parameters}
        for name in given or {}:
            if name not in known:
                raise UnknownNameError("parameter", name, known)
        return {name: p.check((given or {}).get(name, p.default)) for name, p in known.items()}

    def predict(
        self,
        trial: Trial,
        values: Mapping[str, float],
        *,
        velocity: FloatArray | None = None,
        offset: float = 0.0,
        pose: FloatArray | None = None,
        sensor_offsets: Mapping[str, float] | None = None,
    ) -> Prediction:
        """Predict the measured velocities of `trial`, and what its sensors read.

        Args:
            trial: gives the drive and the times.
            values: every parameter of the model by name (bounds are not checked: a fit steps over them).
            velocity: (3,) velocity at the start, in the forward frame; None: at rest.
            offset: clock offset of this trial, a nuisance [s].
            pose: (3,) x, y [m], yaw [rad] at the start; None: as measured, or at 0.
            sensor_offsets: clock offsets of its sensors by name [s]; none without.
        """
        run = self.prepare(trial, values, velocity=velocity, offset=offset)
        rollout = ode.simulate(
            run.fish, run.motion, values=run.coefficients, velocity=run.velocity,
            pose=pose_of(trial) if pose is None else pose,
            coriolis=self.coriolis, loads=run.loads,
        )  # fmt: skip
        state = headed(rollout.at(np.minimum(run.time, run.motion.time[-1])), trial)
        for effect, own in run.active:
            state = effect.reading(state, own, trial)
        message = rollout.message
        if message and run.active:
            message += f" (with {', '.join(f'{e.name}.{k} = {v:g}' for e, own in run.active for k, v in own.items())})"
        late, camera = sensor_offsets or {}, Camera(trial, run.active)
        clocks, which = distinct([camera.clocked(s, s.time + late.get(s.name, 0.0)) for s in trial.sensors])
        here = [camera.moments(run.fish, rollout, run.motion, clock) for clock in clocks]
        sensors = tuple(camera.read(sensor, here[k]) for sensor, k in zip(trial.sensors, which, strict=True))
        return Prediction(state[:, :3], rollout.status, message, rollout, state[:, 3:6], sensors)

    def prepare(
        self,
        trial: Trial,
        values: Mapping[str, float],
        *,
        velocity: FloatArray | None = None,
        offset: float = 0.0,
        keep: Sequence[str] = (),
    ) -> Prepared:
        """Return what is simulated for a trial: the fish and its motion, through the hooks of every effect.

        Args:
            trial, values, velocity, offset: as in `predict`.
            keep: names of effects that act even at their null values, for derivatives there.
        """
        active = active_effects(self, values, keep)
        fish = built(numbered(self.fish, values), active)
        servos = servos_of(active, trial)
        step = _refined(self.step, fish, requested_motion(self.fish.cpg, trial, self.step, self.penalty_share), values)
        time, begun = beginning(active, trial, velocity, offset)
        return Prepared(
            active=active,
            fish=fish,
            motion=walked(
                joint_motion(requested_motion(self.fish.cpg, trial, step, self.penalty_share), servos),
                trial.walk,
                level=trial.level_walk,
            ),
            coefficients={name: values[name] for name in self.fish.coefficient_names},
            loads=loads_of(active, trial),
            velocity=begun,
            time=time,
            step=step,
        )


def numbered(fish: Fish, values: Mapping[str, float]) -> Fish:
    """Return the fish with the values of its free numbers: the same one for the same values."""
    if not fish.known:
        return fish
    return _numbered(Same(fish), tuple((p.name, values.get(p.name, p.default)) for p in fish.numbers))


@functools.lru_cache(maxsize=256)
def _numbered(fish: Same[Fish], values: tuple[tuple[str, float], ...]) -> Fish:
    return fish.thing.with_numbers(dict(values))


def active_effects(model: Model, values: Mapping[str, float], keep: Sequence[str] = ()) -> ActiveEffects:
    """Return the effects off their null values, and those to keep, with their parameters by short names."""
    own = [(effect, effect.short_values(values)) for effect in model.effects]
    return tuple((effect, numbers) for effect, numbers in own if effect.name in keep or not effect.is_null(numbers))


def built(fish: Fish, active: ActiveEffects) -> Fish:
    """Return the fish as it really is: through the hooks ``body`` of effects, one behind the other."""
    for effect, own in active:
        fish = effect.body(fish, own)
    return fish


def beginning(
    active: ActiveEffects, trial: Trial, velocity: FloatArray | None, offset: float
) -> tuple[FloatArray, FloatArray]:
    """Return when the samples were really taken (n,) [s], and the velocity (3,) at the start, at rest if None."""
    time, begun = trial.time + offset, np.zeros(3) if velocity is None else velocity
    for effect, own in active:
        time, begun = effect.clock(time, own), effect.start(begun, own, trial)
    return time, begun


def loads_of(active: ActiveEffects, trial: Trial) -> LoadsOfRun:
    """Return the loads of the effects that have one, with their parameters and their constants of the trial."""
    return tuple(
        (effect.load, (*own.values(), *effect.constants(trial))) for effect, own in active if effect.load is not None
    )


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is simulated for one trial.

    Attributes:
        active: the effects that act, with their values by short names.
        fish: as it really is.
        motion: of its joints, as it really is.
        coefficients: the nine, by name.
        loads: of the active effects that have one, with their parameters.
        velocity: (3,) through the water at the start, in the forward frame.
        time: (n,) at which the samples were really taken [s].
        step: longest step [s].
    """

    active: ActiveEffects
    fish: Fish
    motion: JointMotion
    coefficients: dict[str, float]
    loads: LoadsOfRun
    velocity: FloatArray
    time: FloatArray
    step: float


def pose_of(trial: Trial) -> FloatArray | None:
    """Return where the rollout starts: the measured pose (3,) of the first sample."""
    return None if trial.pose is None else trial.pose[0]


def headed(state: FloatArray, trial: Trial) -> FloatArray:
    """Turn states (n, 8) so that the heading is the measured one at the first sample, where it was measured."""
    if trial.pose is not None:
        state[:, 5] += trial.pose[0, 2] - state[0, 5]
    return state


def requested_motion(cpg: Cpg | None, trial: Trial, step: float, share: float = measured.ALLOWED) -> JointMotion:
    """Return the joint motion a trial asks for: the spline of its measured angles, or the CPG's."""
    if trial.joint_angle is not None:
        return _measured_motion(trial, step, share)
    if trial.wave is not None:
        return wave.joint_motion(
            trial.wave, 0.0 if trial.starts_at_rest else float(trial.time[0]), float(trial.time[-1]) + LEAD, step
        )
    if cpg is None:
        raise InputError(f"trial '{trial.name}' is driven by a CPG, but the fish has none; add [cpg] to the fish")
    return hopf.joint_motion(cpg, trial.drive, float(trial.time[-1]) + LEAD, step)


@cached(0.5e9)
def _measured_motion(trial: Trial, step: float, share: float) -> JointMotion:
    # a staircase is late by half a step, on average
    held = 0.5 * trial.step if trial.commanded and trial.hold == "zero" else 0.0
    return measured.sampled([joint.spline for joint in recorded_joints(trial, share)], trial.time, step, late=held)


@sized_cache(lambda joints: sum(int(joint.spline.c.nbytes + joint.spline.t.nbytes) for joint in joints), 0.1e9)
def recorded_joints(trial: Trial, share: float = measured.ALLOWED) -> tuple[measured.Smoothed, ...]:
    """Return the recorded joint angles, measured ones smoothed.

    The smoothing has a share of its penalty where errors are allowed for. The angles are kept longer than the far
    larger motions.
    """
    angle = np.zeros((0, 0)) if trial.joint_angle is None else trial.joint_angle
    if trial.commanded:
        return tuple(measured.exact(trial.time, column) for column in angle.T)
    smooth = measured.smoothing if trial.measured.any() else functools.partial(measured.eased_smoothing, share=share)
    found = (smooth(trial.time, column) for column in angle.T)
    return tuple(measured.Smoothed(joint.spline, joint.sigma, joint.intensity) for joint in found)


def servos_of(active: ActiveEffects, trial: Trial) -> Servos:
    """Return the effects between the angles of a trial and its joints: of measured angles those of their sensors."""
    return tuple((effect, tuple(own.items())) for effect, own in active if effect.moves_joints(trial))


def joint_motion(asked: JointMotion, servos: Servos) -> JointMotion:
    """Return the joint motion that the joints got: the one asked for, or measured, through the effects of `servos`."""
    return _driven(asked, servos) if servos else asked


def driven(motion: JointMotion, servos: Servos) -> JointMotion:
    """Return a joint motion through effects, one behind the other."""
    for effect, values in servos:
        motion = effect.drive(motion, dict(values))
    return motion


_driven = cached(0.1e9)(driven)


def _refined(step: float, fish: Fish, asked: JointMotion, values: Mapping[str, float]) -> float:
    """Shorten the step, by half octaves, until the elastic deflection of the tail, if any, is integrated well.

    Its rates are those of the spring, sqrt(1 / (compliance J)), of its damping, and of the drag linearised about the
    sideways speed U of the tail, rho c_d U INT h r^2 dr / J; J is the inertia about the joint, half of it because the
    rest of the fish recoils.
    """
    if fish.tail_compliance <= 0.0:
        return step
    link, outline = fish.links[-1], outlines(fish)[-1]
    c_m, c_d = (max(values[f"{kind}.{link.group}"], 0.0) for kind in ("c_m", "c_d"))
    inertia = 0.5 * (link.inertia + link.mass * link.com**2 + c_m * float(outline.added[2]))
    drag = fish.density * c_d * _RECOIL * _tail_speed(fish.links, asked) * float(outline.height_moment[-1, 2])
    rate = np.sqrt(1.0 / (fish.tail_compliance * inertia)) + (fish.tail_damping + drag) / inertia
    octaves = 0.5 * np.ceil(2.0 * np.log2(max(max(step, _COARSE) * rate / _STIFFNESS, 1.0)))
    return float(step / 2.0 ** min(octaves, _FINEST))


def _tail_speed(links: tuple[Link, ...], motion: JointMotion) -> float:
    """Return the largest sideways speed [m/s] of the middle of the last link, for a head held and a body straight."""
    lengths = np.array([link.length for link in links])
    reach = np.cumsum(lengths[:0:-1])[::-1] - 0.5 * lengths[-1]
    return float(np.abs(motion.rate[:, 0] @ reach).max())
