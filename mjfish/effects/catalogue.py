"""Finding causes: the shipped ones by looking into this folder, a user's own by reading a file."""

from __future__ import annotations

import functools
import importlib
import pkgutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

import cloudpickle

from mjfish.effects.effect import Effect
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.files.user_code import user_code
from mjfish.fish import Fish

#: Causes by name, or Python files with causes of a user's own, beside the shipped ones; None: the shipped ones alone.
Causes = Mapping[str, Effect] | str | Path | Sequence[str | Path] | None


@functools.cache
def _shipped() -> dict[str, Effect]:
    package = sys.modules[__package__]
    modules = [importlib.import_module(f"{__package__}.{m.name}") for m in pkgutil.iter_modules(package.__path__)]
    found = [effect for module in modules for effect in _effects_in(module)]
    return {effect.name: effect for effect in sorted(found, key=lambda effect: effect.name)}


def catalogue(given: Causes = None) -> dict[str, Effect]:
    """Return causes by name: those that are given so, else the shipped ones and those in the given files.

    Raises:
        InputError: a file is absent, cannot be run, holds no cause, or a name is taken.
        ParameterError: a cause in a file does not keep the contract.
    """
    if isinstance(given, Mapping):
        for effect in given.values():
            effect.check_declaration()
        return dict(given)
    known = dict(_shipped())
    for path in map(Path, [given] if isinstance(given, (str, Path)) else given or ()):
        with located(str(path)):
            if not path.is_file():
                raise InputError("no such file of effects; correct the path")
            for effect in _from_file(path.resolve(), path.stat().st_mtime_ns):
                if effect.name in known:
                    raise InputError(f"an effect named '{effect.name}' is there already; give yours another name")
                known[effect.name] = effect
    return known


def of_fish(effects: Mapping[str, Effect], fish: Fish) -> dict[str, Effect]:
    """Return the effects with the parameters that they have for `fish`: some have one per joint."""
    return {name: effect.for_fish(fish) or effect for name, effect in effects.items()}


def find(name: str, known: dict[str, Effect] | None = None) -> Effect:
    """Return the cause of that name, or raise `UnknownNameError` listing the known ones."""
    known = catalogue() if known is None else known
    if name not in known:
        raise UnknownNameError("effect", name, known)
    return known[name]


@functools.cache
def _from_file(path: Path, _stamp: int) -> list[Effect]:
    """Run the file and return its causes; again after an edit, which changes the stamp."""
    with user_code(path) as module:
        cloudpickle.register_pickle_by_value(module)  # workers lack the file
        found = _effects_in(module)
        for effect in found:
            if effect.load is not None:
                _ = effect.load.address, effect.load.gradient  # compiled here, where a mistake is the file's
    if not found:
        raise InputError("no subclass of mjfish.effects.Effect found; define one")
    return found


def _effects_in(module: ModuleType) -> list[Effect]:
    """Return one instance of every cause that `module` itself defines."""
    classes = [
        item
        for item in vars(module).values()
        if isinstance(item, type)
        and issubclass(item, Effect)
        and item.__module__ == module.__name__ != Effect.__module__
    ]
    for cause in classes:
        cause.check_declaration()
    return [cause() for cause in classes]
