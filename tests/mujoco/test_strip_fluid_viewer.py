"""The passive viewer, which copies model and data for itself, leaves the water as it is. Needs a display."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def display() -> Iterator[str]:
    """The name of an X display: that of the user, else one of Xvfb's."""
    if "DISPLAY" in os.environ:
        yield os.environ["DISPLAY"]
        return
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("no display: set DISPLAY, or install Xvfb")
    with subprocess.Popen([server, "-displayfd", "1"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as running:
        assert running.stdout is not None
        number = running.stdout.readline().decode().strip()
        if not number:
            pytest.skip("no display: Xvfb does not start")
        yield f":{number}"
        running.terminate()


#: Ends without closing the window: some servers complain of that, which is not the water's affair.
_SCRIPT = """
import os, sys
sys.path.insert(0, sys.argv[1])
import mujoco, mujoco.viewer, numpy as np
from wet_models import full_state, stirred, tree

fluid = tree()
expected, seen = stirred(fluid.model), stirred(fluid.model)
with fluid.installed():
    mujoco.mj_step(fluid.model, expected, nstep=50)
    with mujoco.viewer.launch_passive(fluid.model, seen) as viewer:
        for _ in range(50):
            mujoco.mj_step(fluid.model, seen)
            viewer.sync()
        assert viewer.is_running()
        same = np.array_equal(full_state(fluid.model, seen), full_state(fluid.model, expected))
        print("the same" if same else "another", fluid.state(seen).status, flush=True)
        os._exit(0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the passive viewer is tested on an X display only")
def test_viewer_shows_the_run_that_goes_on_without_it(display: str) -> None:
    """Catches a viewer whose own thread steps, resets or takes the callback away."""
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(Path(__file__).parent)],
        env={**os.environ, "DISPLAY": display, "MUJOCO_GL": "glfw"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout.splitlines()[-1:] == ["the same ok"], done.stderr
