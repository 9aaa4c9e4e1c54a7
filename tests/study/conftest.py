"""The small study, run once."""

from __future__ import annotations

import pytest
from small_study import contents, write_study

from mjfish.study import read_cases, run


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The pieces of the small study, by the name of their file."""
    folder = tmp_path_factory.mktemp("made")
    ran = run(read_cases(write_study(folder)), folder / "out")
    assert (ran.there, ran.made, ran.failed) == (0, 4, 0)
    return contents(folder / "out")
