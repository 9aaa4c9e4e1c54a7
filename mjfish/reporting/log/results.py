"""Which log a result has, by its type."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from mjfish.diagnosis import Diagnosis
from mjfish.errors import InputError
from mjfish.reporting.log.of_diagnosis import write_diagnosis_log


@functools.singledispatch
def write_log(result: Any, path: Path) -> None:
    """Write the swimming in a result as a rerun log.

    Raises:
        InputError: there is no swimming in it, or the file cannot be written.
    """
    raise InputError(f"{path}: {type(result).__name__} has no swimming to log; use report() or plot()")


@write_log.register
def _(result: Diagnosis, path: Path) -> None:
    write_diagnosis_log(result, path)
