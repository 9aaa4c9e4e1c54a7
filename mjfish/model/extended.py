"""A fish extended by effects, with all their numbers: as a file, and as what either engine simulates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from pydantic import Field

from mjfish import fish as fishes
from mjfish.data import Trial
from mjfish.drive.motion import JointMotion
from mjfish.effects import Causes, catalogue, of_fish
from mjfish.effects.effect import Effect, Values
from mjfish.errors import UnknownNameError, located
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table
from mjfish.fish import Fish, write_fish
from mjfish.model.model import LoadsOfRun, Model, active_effects, built, driven, loads_of

#: What to do about an effect that is not shipped.
OWN = "a cause of your own needs its file: --effects FILE"


class _Effects(Table):
    """The table ``effects`` of a fish TOML."""

    effects: dict[str, Annotated[dict[str, float], Field(min_length=1)]]


@dataclass(frozen=True)
class Extended:
    """A model with a value for every parameter of it.

    Attributes:
        model: a fish and its effects.
        values: of all its parameters, by full name.
    """

    model: Model
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check names and bounds, and fill in defaults."""
        object.__setattr__(self, "values", self.model.values(self.values))

    @property
    def active(self) -> tuple[tuple[Effect, Values], ...]:
        """The effects off their null values, with their parameters by short names."""
        return active_effects(self.model, self.values)

    @property
    def fish(self) -> Fish:
        """The fish as it really is, with its coefficients: through every hook ``body``."""
        return built(with_values(self.model.fish, self.values), self.active)

    def loads(self, trial: Trial) -> LoadsOfRun:
        """Return the loads of the water, with their parameters and what they need to know of a trial."""
        return loads_of(self.active, trial)

    def drive(self, motion: JointMotion) -> JointMotion:
        """Return the joint motion that the joints get, from the one that is asked for."""
        return driven(motion, tuple((e, tuple(own.items())) for e, own in self.active if e.domain == "drive"))

    @property
    def seen(self) -> tuple[str, ...]:
        """Names of the effects that act on what the camera reads alone: on the clock or on the reading."""
        reads = [e for e, _ in self.active if e.overrides("clock") or e.overrides("reading")]
        return tuple(e.name for e in reads if not e.overrides("start") and e.load is None)

    def described(self) -> Iterator[str]:
        """Yield lines that say which effects are on, and which of them are of the camera."""
        for effect, own in self.active:
            numbers = ", ".join(f"{p.short} = {own[p.short]:g} {p.unit}".removesuffix(" -") for p in effect.parameters)
            where = "; it changes what the camera reads, not the swimming" if effect.name in self.seen else ""
            yield f"with {effect.name}: {numbers}{where}"


def load(
    fish: Fish | Extended | str | Path,
    effects: Causes = None,
    given: Mapping[str, float] | None = None,
) -> Extended:
    """Return a fish with its effects: those in the tables ``[effects.NAME]`` of its file, and those that get values.

    Args:
        fish: a fish, one with effects, or as `mjfish.load_fish` takes it.
        effects: that may occur, by name, or Python files with causes of your own; None: the shipped ones.
        given: coefficients and parameters of effects by full name, that replace those of the file. A parameter of an
            effect that the file does not have adds it.

    Raises:
        UnknownNameError: no such fish, no such effect or parameter; the known ones are listed.
        InputError: the file breaks the schema, every broken key is named.
        ParameterError: a value outside its bounds.
    """
    given = given or {}
    known = catalogue(effects)
    base = fish if isinstance(fish, Extended) else _alone(fish, known)
    model, known = base.model, of_fish(known, base.model.fish)
    there = {*base.model.fish.coefficient_names, *(effect.name for effect in model.effects)}
    added = dict.fromkeys(name if name in there else name.partition(".")[0] for name in given)
    new = tuple(known[name] for name in added if name in known and name not in there)
    return Extended(replace(model, effects=(*model.effects, *new)), {**base.values, **given})


def _alone(fish: Fish | str | Path, known: Mapping[str, Effect]) -> Extended:
    """Return a fish with the effects of its file."""
    if isinstance(fish, Fish):
        return Extended(Model(fish), {})
    source = str(fish)
    fish, tables = fishes.read(fish)
    known = of_fish(known, fish)
    with located(source):
        entries = tomlfile.parse({"effects": tables}, _Effects, "").effects
        for name in entries:
            if name not in known:
                raise UnknownNameError("effect", name, known, OWN)
        values = {known[name].declaration(short).name: v for name, own in entries.items() for short, v in own.items()}
        return Extended(Model(fish, tuple(known[name] for name in entries)), values)


def write(path: str | Path, model: Model, values: Mapping[str, float], comments: Sequence[str] = ()) -> None:
    """Write a model with its numbers to a fish TOML that `load` reads back, whole or not at all.

    Args:
        path: with the suffix ``.toml``.
        model: a fish and its effects, such as `mjfish.diagnosis.Diagnosis.extended_model`.
        values: by full name; what is absent has its default. A coefficient may lie outside the fish's bounds, which
            are then widened.
        comments: lines at the top.

    Raises:
        InputError: another suffix, or the file cannot be written.
        UnknownNameError, ParameterError: no parameter of that name, or a parameter of an effect outside its bounds.
    """
    fish = with_values(model.fish, values)
    own = Extended(
        replace(model, fish=fish), {name: v for name, v in values.items() if name not in fish.coefficient_names}
    ).values
    effects = {effect.name: {p.short: own[p.name] for p in effect.parameters} for effect in model.effects}
    write_fish(path, fish, comments, effects)


def with_values(fish: Fish, values: Mapping[str, float]) -> Fish:
    """Return the fish with the coefficients and free numbers among `values`; bounds of coefficients give way."""
    changed = {}
    for p in fish.parameters:
        if p.name in values and values[p.name] != p.default:
            value = float(values[p.name])
            changed[p.name] = replace(p, default=value, low=min(p.low, value), high=max(p.high, value))
    return fish.with_numbers(values).with_coefficients(changed)
