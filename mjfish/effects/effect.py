"""The contract of a cause: what it declares, and the hooks it may act through."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import ClassVar, Literal

from mjfish.arrays import FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.errors import ParameterError, UnknownNameError
from mjfish.fish import Fish
from mjfish.hydro.load import PARAMETERS, Load
from mjfish.parameter import Parameter
from mjfish.trial import Dataset

#: Values of an effect's parameters by their short names, e.g. ``{"offset": 0.02}``.
Values = Mapping[str, float]
Family = Literal["data", "drive", "body", "water"]


class Effect(ABC):
    """A physical cause of a difference between simulated and measured swimming.

    A subclass declares class attributes and overrides the hooks it acts through, in the order in which a run flows:
    drive -> body -> water -> camera. Every hook is a pure function of its arguments. The nominal model is what is left
    when no hook is called; `is_null` says when that is so, and then none is.

    Attributes:
        name: unique; parameters are addressed ``name.short``.
        family: where it acts.
        summary: one line, as a reader would say it.
        parameters: its numbers; ``default`` is the null value at which it does nothing. At least one is no ``shape``.
        source: where the physics comes from.
        signature: what the residual looks like if this is the cause.
        confirm: the experiment that would confirm it.
        load: force on every link from outside the Morison model, compiled; its parameters come in declared order.
    """

    name: ClassVar[str]
    family: ClassVar[Family]
    summary: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    source: ClassVar[str]
    signature: ClassVar[str]
    confirm: ClassVar[str]
    load: ClassVar[Load | None] = None

    def not_applicable(self, dataset: Dataset) -> str:
        """Say why `dataset` cannot show this effect; empty where it can."""
        del dataset
        return ""

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Return the joint motion that the joints got, from the one that was asked for."""
        del values
        return motion

    def body(self, fish: Fish, values: Values) -> Fish:
        """Return the fish as it really is."""
        del values
        return fish

    def clock(self, time: FloatArray, values: Values) -> FloatArray:
        """Return the times (n,) [s] at which the samples labelled `time` were really taken."""
        del values
        return time

    def reading(self, state: FloatArray, values: Values) -> FloatArray:
        """Return what the camera reads, from the state (n, 8) in the forward frame (see `mjfish.ode.Rollout`)."""
        del values
        return state

    @classmethod
    def is_null(cls, values: Values) -> bool:
        """Return whether every amplitude is at its null value, so that the effect does nothing."""
        return all(values[p.short] == p.default for p in cls.parameters if not p.shape)

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
        for attribute in ("name", "family", "summary", "parameters", "source", "signature", "confirm"):
            if not getattr(cls, attribute, None):
                raise ParameterError(f"effect {cls.__name__}: attribute '{attribute}' is missing or empty; declare it")
        if all(parameter.shape for parameter in cls.parameters):
            raise ParameterError(f"effect {cls.name}: every parameter is a shape; one must be an amplitude")
        for parameter in cls.parameters:
            if parameter.group != cls.name or not parameter.short:
                raise ParameterError(f"effect {cls.name}: parameter '{parameter.name}' must be named '{cls.name}.NAME'")
        if cls.load is not None and len(cls.parameters) > PARAMETERS:
            raise ParameterError(f"effect {cls.name}: a load may have {PARAMETERS} parameters at most")
