"""Fixtures for tests of MuJoCo in water."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest


@pytest.fixture(autouse=True)
def _as_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take whatever callback a failed test left away; MuJoCo writes its log of warnings into the working directory."""
    monkeypatch.chdir(tmp_path)
    yield
    mujoco.set_mjcb_control(None)
