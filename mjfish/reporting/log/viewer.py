"""Opening a log in the rerun viewer."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from mjfish.errors import InputError, MjfishError


class ViewerError(MjfishError, RuntimeError):
    """The viewer could not be run."""


#: First bytes of every .rrd file.
_MAGIC = b"RRF2"


def view(path: Path) -> None:
    """Open `path` in the rerun viewer; return when it is closed.

    Raises:
        InputError: the file is absent or no rerun log.
        ViewerError: the viewer could not be run.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; write a log with --rrd FILE.rrd, or by mjfish simulate --out DIR")
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise InputError(f"{path}: not a rerun log (.rrd); give the file that --rrd wrote")
    done = subprocess.run([sys.executable, "-m", "rerun", str(path.resolve())], check=False)  # noqa: S603
    if done.returncode != 0:
        raise ViewerError(
            f"{path}: the rerun viewer ended with code {done.returncode}, expected 0; it needs a display: "
            "copy the file to a machine that has one and run 'rerun FILE.rrd' there"
        )
