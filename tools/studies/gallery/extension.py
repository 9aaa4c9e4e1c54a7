"""Sphinx: write the gallery before the pages are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.gallery.pages import write


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", lambda app: write(Path(app.srcdir) / "gallery"))
    return {"parallel_read_safe": True}
