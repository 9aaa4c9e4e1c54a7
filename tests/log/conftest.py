"""What all tests of logs share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rerun as rr


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    """Make rerun raise where it would warn."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)
