"""The oldest dependencies that are promised are those that `make test-oldest` installs."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

_ROOT = Path(__file__).parents[1]


def _name(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_lock_has_the_lower_bound_of_every_dependency() -> None:
    """A bound of 2.1 is met by 2.1.0, or by the first 2.1 that there is."""
    project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (_ROOT / "requirements-oldest.lock").read_text(encoding="utf-8").splitlines()
    locked = {_name(pin.name): pin for pin in (Requirement(line) for line in lines if not line.startswith("#"))}
    for dependency in map(Requirement, project["dependencies"]):
        (bound,) = [Version(part.version) for part in dependency.specifier if part.operator == ">="]
        (pinned,) = [Version(part.version) for part in locked[_name(dependency.name)].specifier]
        assert pinned.release[: len(bound.release)] == bound.release, dependency
