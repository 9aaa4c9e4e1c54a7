"""Python files of a user: run once, and whatever they raise is bad input."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from mjfish.errors import InputError, MjfishError


@contextlib.contextmanager
def user_code(path: Path) -> Iterator[ModuleType]:
    """Run a Python file and yield its module, for what else runs its code.

    Raises:
        InputError: no Python file, or it raised something, there or in the body of the context; says the line.
    """
    spec = importlib.util.spec_from_file_location(f"mjfish_user_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError("not a Python file, expected a name that ends in .py; rename it")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where annotations of its classes are looked up
    try:
        spec.loader.exec_module(module)
        yield module
    except MjfishError:
        raise
    except (Exception, SystemExit) as error:
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        where = f"line {lines[-1]}: " if lines else ""
        raise InputError(f"{where}running the file failed: {type(error).__name__}: {error}; correct it") from error
