"""The contract of a cause: what it declares, and the hooks it may act through."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.drive.motion import JointMotion
from mjfish.effects.calibration import SPRING_BALANCE, Calibration
from mjfish.effects.mechanism import MECHANISMS, Domain
from mjfish.errors import ParameterError, UnknownNameError
from mjfish.fish import KINDS, Fish
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.hydro.load import PARAMETERS, Load
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior

#: Values of an effect's parameters by their short names, e.g. ``{"offset": 0.02}``.
Values = Mapping[str, float]
Part = Literal["start-up", "transition", "steady", "turn", "everywhere"]
#: Exponents of the beat frequency above this size count as a change with frequency.
_SCALES = 0.25
_DECLARED = ("name", "domain", "summary", "parameters", "source", "signature", "confirm")
_HOOKS = ("drive", "body", "clock", "reading", "displacement", "camera")


@dataclass(frozen=True)
class Fingerprint:
    """How the discrepancy looks that a cause leaves; None where the physics does not say.

    The nominal model has two exact symmetries: time scaling, V(t; f) = f U(f t) where the joints move alike, and, in
    straight swimming, the glide reflection (surge, sway, yaw rate)(t + T/2) = (surge, -sway, -yaw rate)(t). A cause
    breaks or keeps each in a known way.

    Attributes:
        exponent: q, the nondimensional discrepancy goes as the beat frequency to the power q; 0 keeps the scaling.
        odd: whether it breaks the glide reflection.
        part: the part of a run where most of it sits.
    """

    exponent: float | None = None
    odd: bool | None = None
    part: Part | None = None


class Effect(ABC):
    """A physical cause of a difference between simulated and measured swimming.

    A subclass declares class attributes and overrides the hooks it acts through, in the order in which a run flows:
    drive -> body -> water -> camera. Every hook is a pure function of its arguments. The nominal model is what is left
    when no hook is called; `is_null` says when that is so, and then none is.

    Attributes:
        name: unique; parameters are addressed ``name.short``.
        domain: where it acts.
        mechanism: of which it is a form, by its name in `mjfish.effects.mechanism`; without one, it is its own.
        learned: whether its form is learned from the data: numbers of a curve, kept smooth by `priors`. It is
            asked for only where no formula of the catalogue explains the data, and to judge such formulas.
        random: whether it is drawn anew for every run (`drawn`). It is simulated, and no candidate that is refitted.
        summary: one line, as a reader would say it.
        parameters: its numbers; ``default`` is the null value at which it does nothing. At least one is no ``shape``.
        source: where the physics comes from.
        signature: what the residual looks like if this is the cause.
        confirm: the experiment that would confirm it.
        fingerprint: how its discrepancy scales, what symmetry it breaks, where it sits.
        calibration: the bench measurement that settles it; None: that of its domain, if there is one.
        resembles: codes of findings about the data (see `mjfish.inspection`) that look like this cause, or with
            which the data cannot show it.
        limits: names of formulas of its mechanism that it becomes at the ends of its parameters.
        of_sensors: whether a cause of the drive acts on measured joint angles, too, as one of their sensors does.
        jerks: whether joints that a cause of the drive moves may change their rate at once, as at a stop: derivatives
            then need the step of the rollout.
        smooth: whether predictions are differentiable in its amplitudes at the null value; else it is always refitted.
        least: share of its scale that an amplitude which cannot be negative keeps from zero in a refit.
        load: force on every link from outside the Morison model, compiled; its parameters come in declared order.

    Example:
        A cause in a file of your own has the same form as those of the catalogue.

        >>> import mjfish
        >>> class GyroGain(mjfish.Effect):
        ...     name, domain, summary = "gyro_gain", "data", "the gyro's gain is off"
        ...     parameters = (mjfish.Parameter("gyro_gain.error", "-", 0.0, -0.3, 0.3, 0.0, 0.02),)
        ...     source, signature, confirm = "data sheet", "the yaw rate is off by a factor", "turn it by hand"
        ...     def reading(self, state, values, trial):
        ...         return state * [1.0, 1.0, 1.0 + values["error"], 1.0, 1.0, 1.0, 1.0, 1.0]
        >>> GyroGain.check_declaration()
        >>> own, off = {"gyro_gain": GyroGain()}, {"gyro_gain.error": 0.1}
        >>> mjfish.simulate("pike", effects=own, values=off, duration=1.0).status
        'ok'
    """

    name: ClassVar[str]
    domain: ClassVar[Domain]
    mechanism: ClassVar[str] = ""
    learned: ClassVar[bool] = False
    random: ClassVar[bool] = False
    summary: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    source: ClassVar[str]
    signature: ClassVar[str]
    confirm: ClassVar[str]
    fingerprint: ClassVar[Fingerprint] = Fingerprint()
    calibration: ClassVar[Calibration | None] = None
    resembles: ClassVar[tuple[str, ...]] = ()
    limits: ClassVar[tuple[str, ...]] = ()
    of_sensors: ClassVar[bool] = False
    jerks: ClassVar[bool] = True
    smooth: ClassVar[bool] = True
    least: ClassVar[float] = 0.002
    load: ClassVar[Load | None] = None

    def __init_subclass__(cls) -> None:
        """Let a cause that names no mechanism be one by itself."""
        super().__init_subclass__()
        cls.mechanism = cls.mechanism or getattr(cls, "name", "")

    def moves_joints(self, trial: Trial) -> bool:
        """Return whether this effect stands between the angles of `trial` and its joints."""
        return self.domain == "drive" and (not trial.joints_measured or (self.of_sensors and trial.errors is None))

    def not_applicable(self, dataset: Dataset) -> str:
        """Say why `dataset` cannot show this effect; empty where it can."""
        if self.domain == "drive" and not any(map(self.moves_joints, dataset.trials)):
            return "the joint angles were measured, so no servo stands between them and the model"
        return ""

    def parameter_priors(self, dataset: Dataset) -> dict[str, ParameterPrior]:
        """Return what `dataset` says is not known well of how it was taken, by full name of a parameter.

        The effect is then a part of the nominal model.
        """
        del dataset
        return {}

    def cannot_act(self, trial: Trial) -> str:
        """Say why a simulated run cannot have this effect, whatever its size; empty where it can."""
        del trial
        return ""

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """Return numbers, by short name, that are drawn anew for every run; none: the cause is not random."""
        del rng
        return {}

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return numbers of the trial that the load gets behind its parameters: where the walls are, say."""
        del trial
        return ()

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return the joint motion that the joints got, from the one that was asked for."""
        del values
        return motion

    def body(self, fish: Fish, values: Values) -> Fish:
        """Return the fish as it really is."""
        del values
        return fish

    def start(self, velocity: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Return the velocity (3,) through the water with which `trial` begins, in the forward frame.

        `velocity` is the one without this effect: zero, or free in the fit where the trial does not begin at rest.
        """
        del values, trial
        return velocity

    def clock(self, time: FloatArray, values: Values) -> FloatArray:
        """Return the times (n,) [s] at which the samples labelled `time` were really taken."""
        del values
        return time

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Return what the camera reads in `trial`, from the state (n, 8) (forward frame, see `mjfish.ode.Rollout`).

        Its rows are the trial's samples.
        """
        del values, trial
        return state

    def displacement(self, time: FloatArray, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Return by how much a tracked point moves on its link, forward and to port (m, 2) [m].

        Unlike `camera`, this hook may depend on the whole motion.

        Args:
            time: (m,) of all samples of a sensor [s].
            state: (m, 8) at these times, as in `reading`.
            values: parameters by short name.
            trial: that is filmed.
        """
        del time, values, trial
        return np.zeros((len(state), 2))

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Return where the camera sees points of the fish (m, 2) [m], and their headings (m,) [rad], in the world.

        What sensors of places and headings read passes through this hook; what inertial units read does not.

        Args:
            time: (m,) at which they are seen [s].
            place: (m, 2) of a point in the frame of the water [m].
            heading: (m,) of the link that it is on [rad].
            values: parameters by short name.
            trial: that is filmed.
        """
        del time, values, trial
        return place, heading

    def priors(self) -> tuple[Prior, ...]:
        """Return what keeps a learned form smooth, and what is known of its numbers beforehand."""
        return ()

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return numbers, by short name, at which it is like another formula of its mechanism; none: unknown.

        A fit of a learned form, or of one with `limits`, begins there, too.
        """
        del formula, values
        return {}

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect | None:
        """Return the effect as `fish` has it, where its parameters depend on the fish; None where they do not."""
        del fish
        return None

    @classmethod
    def unclear_under(cls, code: str) -> bool:
        """Return whether data with a finding of this code cannot tell or show this cause."""
        shown = {"design-no-turn": "turn", "design-no-start": "start-up"}
        if code == "design-one-frequency" and abs(cls.fingerprint.exponent or 0.0) > _SCALES:
            return True
        return code in cls.resembles or (code in shown and cls.fingerprint.part == shown[code])

    @classmethod
    def overrides(cls, hook: str) -> bool:
        """Return whether the effect acts through this hook."""
        return getattr(cls, hook) is not getattr(Effect, hook)

    def short_values(self, values: Values) -> dict[str, float]:
        """Return the effect's parameters by short names, from values by full names."""
        return {p.short: values[p.name] for p in self.parameters}

    @classmethod
    def amplitudes(cls) -> tuple[Parameter, ...]:
        """Return the parameters that say how much the effect does: all but the shapes."""
        return tuple(p for p in cls.parameters if not p.shape)

    @classmethod
    def starts_off_null(cls) -> bool:
        """Return whether an amplitude is declared to start off its null value: it does nothing up to some size."""
        return any(p.start != p.default for p in cls.amplitudes())

    @classmethod
    def is_null(cls, values: Values) -> bool:
        """Return whether every amplitude is at its null value, so that the effect does nothing."""
        return all(values[p.short] == p.default for p in cls.amplitudes())

    @classmethod
    def declaration(cls, short: str) -> Parameter:
        """Return the parameter with this short name."""
        for parameter in cls.parameters:
            if parameter.short == short:
                return parameter
        raise UnknownNameError(f"parameter of {cls.name}", short, [p.short for p in cls.parameters])

    @classmethod
    def check_declaration(cls) -> None:
        """Raise `ParameterError` where the class does not keep the contract."""
        for complaint in _complaints(cls):
            raise ParameterError(f"effect {cls.__name__}: {complaint}")


class PictureForm(Effect):
    """What causes that bend the picture of the camera have in common: they move places, and turn headings with them.

    Velocities that somebody made of such places have no place to be corrected at.
    """

    domain: ClassVar[Domain] = "data"

    def not_applicable(self, dataset: Dataset) -> str:
        """Say that no place was measured, where that is so."""
        return (
            ""
            if not all(map(self.cannot_act, dataset.trials))
            else "no place was measured: a bent picture moves places"
        )

    def cannot_act(self, trial: Trial) -> str:
        """Say that no sensor of the trial reads a place, where that is so."""
        why = "it has no sensor of a place, which a bent picture would move"
        return "" if any(sensor.kind == "position" for sensor in trial.sensors) else why

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Move the places, and turn the headings with the picture."""
        del time, trial
        centre = np.array([values["x"], values["y"]])
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        away, seen = self.picture(place - centre, ahead, values)
        turned = np.arctan2(ahead[:, 0] * seen[:, 1] - ahead[:, 1] * seen[:, 0], np.sum(ahead * seen, axis=1))
        return centre + away, heading + turned

    @abstractmethod
    def picture(self, away: FloatArray, ahead: FloatArray, values: Values) -> tuple[FloatArray, FloatArray]:
        """Return where the picture has places (n, 2), and the directions (n, 2) of short lines there, of any length.

        Args:
            away: (n, 2) true places, from the point c of the parameters x and y [m].
            ahead: (n, 2) true directions.
            values: of the parameters, by short name.
        """


class ServoForm(Effect):
    """What the forms of the mechanism ``servo_dynamics`` have in common: the joints follow their command late."""

    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    confirm: ClassVar[str] = "log the joint angles on the bench while the command steps"
    resembles: ClassVar[tuple[str, ...]] = ("clock-drift", "clock-jump", "design-no-start", "repeats-differ")
    smooth: ClassVar[bool] = False


class TailForm(Effect):
    """What the forms of the mechanism ``tail_flexibility`` have in common: the tail bends."""

    domain: ClassVar[Domain] = "body"
    mechanism: ClassVar[str] = "tail_flexibility"
    confirm: ClassVar[str] = "hold the peduncle, load the fin with a spring balance and read the deflection"
    calibration: ClassVar[Calibration | None] = SPRING_BALANCE
    smooth: ClassVar[bool] = False
    #: A tail that is stiffer than this asks for a step that is shorter than any data can see.
    least: ClassVar[float] = 0.02


@functools.cache
def variant(cause: type[Effect], **attributes: Hashable) -> Effect:
    """Return a cause with class attributes of its own, those of a fish; always the same instance for the same ones.

    So that what was computed with it is found again.
    """
    made: Effect = type(cause.__name__, (cause,), {"__module__": cause.__module__, **attributes})()
    return made


def each_joint(declared: Parameter, joints: int) -> tuple[Parameter, ...]:
    """Return a parameter for every joint of a fish, numbered from the head on: ``name_1``, ``name_2``, ..."""
    return tuple(
        replace(declared, name=f"{declared.name}_{i}", about=f"{declared.about} {i}") for i in range(1, joints + 1)
    )


def _complaints(cls: type[Effect]) -> Iterator[str]:
    """Say what is wrong with a declaration; a later complaint takes for granted that there was none before it."""
    for attribute in _DECLARED:
        if not getattr(cls, attribute, None):
            yield f"attribute '{attribute}' is missing or empty; declare it"
    if not str(cls.name).isidentifier() or cls.name in KINDS:
        yield f"name '{cls.name}', expected letters, digits and _, and no kind of coefficient; choose another"
    if cls.domain not in get_args(Domain):
        yield f"domain '{cls.domain}', expected one of {', '.join(get_args(Domain))}; correct it"
    elif (known := MECHANISMS.get(cls.mechanism)) is not None and known.domain != cls.domain:
        yield f"domain '{cls.domain}', but its mechanism {known.name} is of domain {known.domain}; correct one"
    if not isinstance(cls.parameters, tuple) or not all(isinstance(p, Parameter) for p in cls.parameters):
        yield "parameters must be a tuple of Parameter; with one, write (Parameter(...),)"
    if all(parameter.shape for parameter in cls.parameters):
        yield "every parameter is a shape; one must be an amplitude"
    for parameter in cls.parameters:
        if parameter.group != cls.name or not parameter.short.isidentifier():
            yield f"parameter '{parameter.name}' must be named '{cls.name}.NAME'"
    if len({parameter.name for parameter in cls.parameters}) < len(cls.parameters):
        yield "two parameters share a name; give each its own"
    if cls.load is not None and not isinstance(cls.load, Load):
        yield "load must be compiled; write @mjfish.hydro.load.load above its function"
    if cls.load is not None and len(cls.parameters) > PARAMETERS:
        yield f"a load may have {PARAMETERS} parameters at most"
    if cls.load is None and not any(cls.overrides(hook) for hook in _HOOKS):
        yield f"it does nothing; declare a load, or override one of {', '.join(_HOOKS)}"
