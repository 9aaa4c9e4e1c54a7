"""Take the picture of the report's first screen for the README, in headless Chromium.

    python tools/report_picture.py out/learned/report.html --out docs/images/report.png

The report is that of `mjfish demo --learned`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

from mjfish.errors import InputError

WIDTH, HEIGHT = 1280, 860
#: The browser's own time that figures have to be drawn [ms].
_PATIENCE = 8000


def take(report: Path, picture: Path) -> None:
    """Write the first screen of a page as PNG.

    Raises:
        InputError: there is no Chromium, or it wrote nothing.
    """
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        raise InputError("Chromium is not installed; install it")
    options = ["--headless", "--no-sandbox", "--hide-scrollbars", f"--virtual-time-budget={_PATIENCE}"]
    picture.unlink(missing_ok=True)
    command = [browser, *options, f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={picture.resolve()}"]
    done = subprocess.run([*command, report.resolve().as_uri()], capture_output=True, text=True, check=False)
    if not picture.is_file():
        raise InputError(f"{report}: no picture was taken: {done.stderr.strip()[-300:]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path, help="HTML file")
    parser.add_argument("--out", type=Path, required=True, help="PNG file")
    given = parser.parse_args()
    take(given.report, given.out)
