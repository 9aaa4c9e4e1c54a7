"""Fixtures that every test may use. Add yours below; keep them small.

pytest puts this folder on the path: `referee.py`, which is no test, is imported by its plain name from anywhere.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mjfish.fish import Fish, load_fish

_ROOT = Path(__file__).parents[1]


def _folder(variable: str, beside: str) -> Path:
    """Return the folder named by an environment variable, else the one beside the repository; skip where absent."""
    folder = Path(os.environ.get(variable, _ROOT.parent / beside))
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent; name the folder by {variable}")
    return folder


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of the reference trajectories (another formulation of the nominal fish), one CSV a case."""
    return _folder("MJFISH_REFERENCE", "shared/reference")


@pytest.fixture(scope="session")
def fishsim() -> Path:
    """Folder of the measured fishsim marker files."""
    return _folder("MJFISH_FISHSIM", "shared/data/fishsim")


@pytest.fixture(scope="session")
def pike() -> Fish:
    """The nominal fish."""
    return load_fish("pike")


@pytest.fixture(scope="session")
def foreign_poses() -> Path:
    """Folder of folders of poses of a pike that another simulator swam."""
    return _folder("MJFISH_POSES", "shared/data/poses")


@pytest.fixture(scope="session")
def foreign_carp() -> Path:
    """Folder of poses of a fish with three joints that another simulator swam, with its TOML."""
    return _folder("MJFISH_CARP", "shared/data/carp")
