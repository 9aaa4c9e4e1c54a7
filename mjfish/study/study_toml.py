"""The tables of a study: datasets, settings and seeds; every dataset meets every setting with every seed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mjfish.data.dataset_toml import FILE, Number, Positive
from mjfish.drive.modes import DURATION, MODES
from mjfish.effects import Effect, catalogue, find, of_fish
from mjfish.errors import InputError, located
from mjfish.estimation import Settings
from mjfish.estimation.settings import Loss, Weights
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table
from mjfish.files.writing import exists
from mjfish.fish import Fish, load_fish

Seed = Annotated[int, Field(ge=0)]


class Named(Table):
    """An entry with a name, by which tables and summaries call it."""

    name: Annotated[str, Field(min_length=1)]


class Generated(Named):
    """One entry of ``[[generate]]``, see `mjfish.generate`: noise in m/s, m/s and rad/s, rate in Hz, duration in s."""

    fish: str = "pike"
    modes: Annotated[tuple[Literal[tuple(MODES)], ...], Field(min_length=1)]  # type: ignore[valid-type]
    effects: Annotated[dict[str, dict[str, Number]], Field(default_factory=dict)]
    values: Annotated[dict[str, Number], Field(default_factory=dict)]
    noise: Annotated[tuple[Number, ...], Field(min_length=3, max_length=3)] = (0.01, 0.01, 0.05)
    rate: Positive = 50.0
    duration: Positive = DURATION
    held_out: tuple[str, ...] = ()


class Folder(Named):
    """One entry of ``[[folder]]``: a dataset's folder, from that of the study's file."""

    path: Annotated[str, Field(min_length=1)]


class Identify(Named):
    """One entry of ``[[identify]]``, see `mjfish.estimation.Settings`."""

    free: tuple[str, ...] = ("*",)
    loss: Loss = "linear"
    weights: Weights = "noise"
    starts: Annotated[int, Field(ge=1)] = 16


class Diagnose(Named):
    """One entry of ``[[diagnose]]``."""


class Study(Table):
    """A study.

    Attributes:
        schema_: version of this file.
        seeds: of the noise of generated datasets, of the starts of an identification, and of a diagnosis.
        generate, folder: the datasets.
        identify, diagnose: what is done with each.
    """

    schema_: Annotated[Literal[1], Field(alias="schema")]
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    generate: tuple[Generated, ...] = ()
    folder: tuple[Folder, ...] = ()
    identify: tuple[Identify, ...] = ()
    diagnose: tuple[Diagnose, ...] = ()


def read_study(path: Path) -> Study:
    """Read a study.

    Raises:
        InputError: the file is absent or breaks the schema; it lacks datasets or settings; a name is taken twice; a
            folder holds no dataset.
        UnknownNameError: an effect, one of its parameters, or a fish is unknown.
    """
    study = tomlfile.read(path, Study)
    with located(str(path)):
        _check_names("dataset", "[[generate]] or [[folder]]", (*study.generate, *study.folder))
        _check_names("setting", "[[identify]] or [[diagnose]]", (*study.identify, *study.diagnose))
        if len(set(study.seeds)) < len(study.seeds):
            raise InputError("seeds: one is given twice; give each once")
        for generated in study.generate:
            with located(f"generate {generated.name}"):
                acting(generated, fish_of(generated, path.parent))
        for folder in study.folder:
            if not exists(path.parent / folder.path / FILE):
                raise InputError(f"folder {folder.name}: {path.parent / folder.path} holds no {FILE}; correct the path")
        for identify in study.identify:
            with located(f"identify {identify.name}"):
                Settings(free=identify.free, loss=identify.loss, weights=identify.weights, starts=identify.starts)
    return study


def _check_names(what: str, where: str, entries: Sequence[Named]) -> None:
    names = [entry.name for entry in entries]
    if not names:
        raise InputError(f"there is no {what}; add one by {where}")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two {what}s are named '{name}'; rename one")


def fish_of(generated: Generated, home: Path) -> Fish:
    """Return the fish of a generated dataset; a path starts at `home`."""
    return load_fish(generated.fish, home)


def acting(generated: Generated, fish: Fish) -> tuple[list[Effect], dict[str, float]]:
    """Return the effects that act in a generated dataset, and all values that are given, by full name."""
    known = of_fish(catalogue(), fish)
    for name in generated.values:
        if name.partition(".")[0] in known:
            raise InputError(f"values: {name} is of an effect; write it in the table effects")
    effects: list[Effect] = []
    values = dict(generated.values)
    for name, own in generated.effects.items():
        effect = find(name, known)
        if not own:
            raise InputError(f"effect {name}: has no value; give one of its parameters a value")
        effects.append(effect)
        values.update({effect.declaration(short).name: value for short, value in own.items()})
    return effects, values
