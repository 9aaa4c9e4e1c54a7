"""Provenance: from which inputs, by which versions a result came."""

from __future__ import annotations

import hashlib
import platform
import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mjfish.trial import Dataset


def provenance(dataset: Dataset, seed: int) -> dict[str, Any]:
    """Return versions, git commit, seed and SHA-256 of every input file, as plain data."""
    files = [path for path in (dataset.source, *(trial.source for trial in dataset.trials)) if path is not None]
    return {
        "versions": {name: version(name) for name in ("mjfish", "numpy", "scipy", "numba")},
        "python": platform.python_version(),
        "commit": _commit(),
        "seed": seed,
        "inputs": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files if path.is_file()},
    }


def _commit() -> str | None:
    """Return the git commit of the package's sources, None outside a checkout."""
    git = shutil.which("git")
    root = Path(__file__).resolve().parents[2]
    if git is None or not (root / ".git").exists():
        return None
    done = subprocess.run(  # noqa: S603 - fixed arguments
        [git, "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or None
