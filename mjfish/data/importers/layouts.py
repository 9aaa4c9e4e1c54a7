"""Marker layouts that come with the package, one TOML each in `mjfish/data/importers/layouts`."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent / "layouts"


def layout(name: str) -> Path:
    """Return the mapping file of a shipped layout."""
    return _FOLDER / f"{name}.toml"
