from __future__ import annotations

import pytest

from mjfish import fish


@pytest.fixture(scope="session")
def pike_toml() -> str:
    """Text of the nominal fish's file."""
    return fish.shipped()["pike"].read_text(encoding="utf-8")
