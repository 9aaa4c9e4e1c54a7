"""A fish as a TOML file that `mjfish.fish.load_fish` reads back as the same fish, to the last bit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from mjfish.errors import InputError
from mjfish.files import tomlfile, writing
from mjfish.fish import Fish


def text(
    fish: Fish, comments: Sequence[str] = (), effects: Mapping[str, Mapping[str, float]] = MappingProxyType({})
) -> str:
    """Return the fish as TOML.

    Args:
        fish: the fish.
        comments: lines at the top, such as where the numbers come from.
        effects: that extend it, by name, their parameters by short name (`mjfish.model.extended` reads them back).

    Raises:
        InputError: the fish breaks its own schema, so that it could not be read back.
    """
    table = fish.model_dump(by_alias=True)
    if tomlfile.parse(table, Fish, f"fish '{fish.name}'") != fish:
        raise InputError(f"fish '{fish.name}' holds values of types that TOML does not keep; build it by Fish(...)")
    lines = [
        f"# {line}".rstrip()
        for comment in comments  # TOML forbids control characters in them
        for line in "".join(c if c.isprintable() or c == "\n" else " " for c in comment).splitlines()
    ]
    return "\n".join([*lines, tomlfile.text({**table, "effects": effects} if effects else table)])


def write(
    path: str | Path,
    fish: Fish,
    comments: Sequence[str] = (),
    effects: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> None:
    """Write the fish to the TOML file `path`, whole or not at all.

    Args:
        path: with the suffix ``.toml``, by which `mjfish.fish.load_fish` knows a file from a name.
        fish: the fish.
        comments: lines at the top.
        effects: that extend it, as in `text`.

    Raises:
        InputError: another suffix, the file cannot be written, or the fish could not be read back.
    """
    path = Path(path)
    writing.check_suffix(path, ".toml")
    writing.write_text(path, text(fish, comments, effects))
