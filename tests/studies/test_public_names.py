"""The studies use what any user of the package can: public names."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "tools" / "studies"
#: Modules of packages whose ``__init__`` imports nothing, to be light; every name in them without underscore is public.
MODULES = {
    "mjfish.errors",
    "mjfish.files.tomlfile",
    "mjfish.files.plain_data",
    "mjfish.files.writing",
    "mjfish.fish.frames",
    "mjfish.fish.outline",
    "mjfish.numerics.arrays",
    "mjfish.drive.cpg",
    "mjfish.drive.measured",
    "mjfish.drive.modes",
    "mjfish.drive.motion",
    "mjfish.model.extended",
}


def _is_public(module: str, name: str) -> bool:
    """Return whether a package exports a name."""
    if name.startswith("_"):
        return False
    found = importlib.import_module(module)
    if module == "mjfish" or hasattr(found, "__path__"):
        below = f"{module}.{name}"
        return name in getattr(found, "__all__", ()) or below in MODULES or module in MODULES
    return module in MODULES


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_study_imports_public_names_only(path: Path) -> None:
    """Catches a study that looks into a package."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "mjfish":
            for alias in node.names:
                assert _is_public(str(node.module), alias.name), f"{node.module}.{alias.name} is not public"
        elif isinstance(node, ast.Import):
            assert not any(alias.name.startswith("mjfish.") for alias in node.names)
