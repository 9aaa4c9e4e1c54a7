"""The picture of a report's first screen."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from PIL import Image

import report_picture
from mjfish.errors import InputError


@pytest.mark.skipif(shutil.which("chromium") is None, reason="Chromium is not installed")
def test_it_is_what_the_page_shows_first(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("<body style='margin: 0; background: #13808c'><p style='margin-top: 2000px'>below</p></body>")
    report_picture.take(page, tmp_path / "page.png")
    with Image.open(tmp_path / "page.png") as picture:
        assert picture.size == (report_picture.WIDTH, report_picture.HEIGHT)
        assert picture.convert("RGB").getpixel((10, 10)) == (0x13, 0x80, 0x8C)


def test_without_a_browser_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="install"):
        report_picture.take(tmp_path / "page.html", tmp_path / "page.png")
