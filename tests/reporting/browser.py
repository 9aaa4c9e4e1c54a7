"""A page in headless Chromium: what it complains of, and what is wider than it."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

#: Before anything else runs: what the page complains of. Behind everything: what is there to see.
_LISTEN = """<script>
window.complaints = [];
for (const kind of ["error", "warn"]) console[kind] = (...what) => complaints.push(what.join(" "));
addEventListener("error", (event) => complaints.push(event.message), true);
addEventListener("unhandledrejection", (event) => complaints.push(String(event.reason)));
addEventListener("securitypolicyviolation", (event) => complaints.push(`refused: ${event.blockedURI}`));
</script>"""
_PROBE = """<script>
addEventListener("load", () => setTimeout(() => {
  ACTION
  const width = document.documentElement.clientWidth;
  const outside = (element) => element.getBoundingClientRect().right > width + 0.5
    && element.getClientRects().length && !element.parentElement.closest(".wide");
  const wide = [...document.body.querySelectorAll("*")].filter(outside)
    .map((element) => `${element.tagName} ${element.className.baseVal ?? element.className}`);
  const found = {
    asked: innerWidth, width, page: document.documentElement.scrollWidth, wide: wide.slice(0, 8), complaints,
    drawn: document.querySelectorAll(".main-svg").length,
    result: (() => { try { return RESULT; } catch (error) { return `failed: ${error}`; } })(),
  };
  parent.postMessage(JSON.stringify(found), "*");
}, 0));
</script>"""
#: The page stands in a frame: a window of its own is never narrower than 500 pixels.
_FRAME = """<!DOCTYPE html><body style="margin: 0">
<pre id="probe"></pre><iframe src="page.html" style="border: 0; width: WIDTHpx; height: 1600px"></iframe>
<script>addEventListener("message", (event) => {
  document.getElementById("probe").textContent = event.data;
});</script>"""


@dataclass(frozen=True)
class Seen:
    """What a browser made of a page.

    Attributes:
        complaints: errors and warnings of its console, and what its security policy refused.
        width, page: of the window and of what is in it [px].
        wide: elements that leave the window and do not scroll by themselves.
        drawn: how many figures were drawn.
        result: of the expression that was asked for.
    """

    complaints: list[str]
    width: int
    page: int
    wide: list[str]
    drawn: int
    result: Any


def look(page: str, width: int, action: str = "", result: str = "null") -> Seen:
    """Return what headless Chromium makes of a page, after some JavaScript; skip where there is no Chromium."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("Chromium is not installed: no browser to open the page in")
    probe = _PROBE.replace("ACTION", action).replace("RESULT", result)
    head, body, end = page.partition("<head>")
    text = head + body + _LISTEN + end.replace("</html>", f"{probe}</html>")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "page.html").write_text(text, encoding="utf-8")
        file = Path(folder, "frame.html")
        file.write_text(_FRAME.replace("WIDTH", str(width)), encoding="utf-8")
        command = [
            chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--dump-dom",
            "--virtual-time-budget=5000", f"--user-data-dir={folder}/profile", "--window-size=1400,1700", file.as_uri(),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    found = re.search(r'<pre id="probe">(.+?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, f"the page did not load: {done.stderr[-2000:]}"
    seen = json.loads(html.unescape(found.group(1)))
    assert seen.pop("asked") == width
    return Seen(**seen)
