"""Fixtures that every test may use. Add yours below; keep them small."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from mjfish import fish as fishes
from mjfish.fish import Fish

_ROOT = Path(__file__).parents[1]
# `referee.py` lies here and is no test: tests in subfolders import it by its plain name.
sys.path.insert(0, str(Path(__file__).parent))


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
    return fishes.load("pike")
