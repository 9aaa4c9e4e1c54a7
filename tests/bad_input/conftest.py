from __future__ import annotations

import pytest
from readers import Reader, readers


@pytest.fixture(scope="session")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reader]:
    """Every reader by its file's name."""
    return readers(tmp_path_factory.mktemp("made"))
