"""Provenance: from which inputs, by which versions a result came."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.data import Dataset
from mjfish.effects import Effect
from mjfish.fish import fish_text

_PACKAGE = Path(__file__).resolve().parents[1]


def provenance(dataset: Dataset, candidates: Sequence[Effect], seed: int) -> dict[str, Any]:
    """Return versions, git commit, seed and SHA-256 of the fish and of every input file, as plain data.

    Input files are those of the dataset, by their path from its folder, and those of causes that are not shipped.
    """
    files = [path for path in (dataset.source, *(trial.source for trial in dataset.trials)) if path is not None]
    home = Path() if dataset.source is None else dataset.source.parent
    inputs = {os.path.relpath(path, home): path for path in files} | {
        path.name: path for path in _external_files(candidates)
    }
    return {
        "versions": {name: version(name) for name in ("mjfish", "numpy", "scipy", "numba")},
        "python": platform.python_version(),
        "commit": _commit(),
        "seed": seed,
        "fish": hashlib.sha256(fish_text(dataset.fish).encode()).hexdigest(),
        "inputs": {
            name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in inputs.items() if path.is_file()
        },
    }


def identity(dataset: Dataset, candidates: Sequence[Effect], seed: int) -> dict[str, Any]:
    """Return all that a diagnosis depends on as plain data, hashes in place of arrays and files."""
    own = {name: _summed(getattr(dataset, name)) for name in ("trials", "noise", "clock", "known", "filter")}
    return {**provenance(dataset, candidates, seed), "effects": [effect.name for effect in candidates], "dataset": own}


def _summed(value: Any) -> Any:
    """Return a part of a dataset as plain data, hashes in place of arrays; where files lie does not matter."""
    if isinstance(value, np.ndarray):
        return [list(value.shape), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if is_dataclass(value):
        return {entry.name: _summed(getattr(value, entry.name)) for entry in fields(value) if entry.name != "source"}
    if isinstance(value, Mapping):
        return {key: _summed(item) for key, item in value.items()}
    return [_summed(item) for item in value] if isinstance(value, (tuple, list)) else repr(value)


def _external_files(candidates: Sequence[Effect]) -> list[Path]:
    """Return the files of the causes that do not come with the package; a class made by `type` is said to be in abc."""
    names = {type(effect).__module__ for effect in candidates} - sys.stdlib_module_names
    modules = [sys.modules.get(name) for name in names]
    files = [Path(module.__file__).resolve() for module in modules if module and module.__file__]
    return sorted(file for file in files if not file.is_relative_to(_PACKAGE))


def _commit() -> str | None:
    """Return the git commit of the package's sources, None outside a checkout."""
    git = shutil.which("git")
    root = _PACKAGE.parent
    if git is None or not (root / ".git").exists():
        return None
    done = subprocess.run(  # noqa: S603 - fixed arguments
        [git, "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or None
