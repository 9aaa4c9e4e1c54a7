"""Opening a log in the rerun viewer."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from mjfish.errors import InputError

#: First bytes of every .rrd file.
_MAGIC = b"RRF2"


def view(path: Path) -> None:
    """Open `path` in the rerun viewer and return while it runs.

    Raises:
        InputError: the file is absent or no rerun log.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; write a log with --rrd FILE.rrd, or by mjfish simulate --out DIR")
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise InputError(f"{path}: not a rerun log (.rrd); give the file that --rrd wrote")
    subprocess.Popen([sys.executable, "-m", "rerun", str(path.resolve())], start_new_session=True)  # noqa: S603
