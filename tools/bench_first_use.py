"""What `tools/bench.py` tells of a fresh installation: how long the first command compiles."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile

from mjfish.cli.diagnose import DEMO

#: Names and command lines; `OUT` is a folder that is thrown away.
_COMMANDS = {
    "first_use_s": ("demo", "--out", "OUT"),
    "first_identify_s": ("identify", str(DEMO), "--json", "OUT.json"),
}
_BOUND = 20.0


def compilation() -> dict[str, tuple[float, float]]:
    """Return the seconds of processor time that commands take longer with nothing compiled, and their bound."""
    found = {}
    for name, command in _COMMANDS.items():
        with tempfile.TemporaryDirectory() as folder:
            arguments = [part.replace("OUT", f"{folder}/out") for part in command]
            first, second = (_seconds(arguments, folder) for _ in range(2))
        found[name] = (first - second, _BOUND)
    return found


def _seconds(arguments: list[str], cache: str) -> float:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(
        [sys.executable, "-c", "from mjfish.cli import main; main()", *arguments],
        env=environment,
        check=True,
        capture_output=True,
    )
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
