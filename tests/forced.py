"""Solvers that are made to fail, by the module that calls them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy import optimize

#: Calls of a solver: the module that makes it, the library, the function.
CALLS: Sequence[tuple[str, str, str]] = [
    (f"mjfish.{module}", library, function)
    for module, library, functions in (
        ("block_angular", "numpy.linalg", "qr svd"),
        ("arrays", "numpy.linalg", "svd eigh"),
        ("estimation.fit", "scipy.optimize", "lsq_linear"),
        ("estimation.residual", "numpy.linalg", "eigh det"),
        ("estimation.residual_tests", "numpy.linalg", "eigh"),
        ("estimation.residual_tests", "scipy.linalg", "eigh"),
        ("estimation.serial_correlation", "numpy.linalg", "eigh"),
        ("estimation.intervals", "numpy.linalg", "svd"),
        ("estimation.identifiability", "numpy.linalg", "svd"),
        ("estimation.stability", "numpy.linalg", "qr svd eigh cholesky solve slogdet"),
        ("estimation.stability", "scipy.optimize", "minimize"),
        ("estimation.marginal_likelihood", "numpy.linalg", "pinv svd"),
        ("noise.sample", "numpy.linalg", "qr svd"),
        ("noise.autoregressive", "scipy.linalg", "solve_toeplitz solve_discrete_lyapunov eigvals"),
        ("noise.autoregressive", "numpy.linalg", "eigvalsh"),
        ("noise.kalman", "numpy.linalg", "inv cholesky solve"),
        ("noise.spectral", "scipy.optimize", "minimize minimize_scalar"),
        ("noise.spectral", "numpy.linalg", "inv slogdet"),
        ("noise.spectral", "scipy.linalg", "expm"),
        ("inspection.samples", "numpy.linalg", "lstsq"),
        ("inspection.after_fit", "numpy.linalg", "qr lstsq"),
        ("inspection.kinematics", "numpy.linalg", "lstsq pinv"),
        ("diagnosis.evidence", "numpy.linalg", "pinv eigh"),
        ("diagnosis.held_out", "numpy.linalg", "svd"),
        ("diagnosis.select", "numpy.linalg", "eigh"),
        ("diagnosis.implausible_noise", "numpy.linalg", "eigh"),
        ("diagnosis.missing_force", "numpy.linalg", "solve lstsq"),
        ("diagnosis.description", "numpy.linalg", "solve lstsq"),
        ("diagnosis.forms", "numpy.linalg", "eigh"),
    )
    for function in functions.split()
]


def names(calls: Sequence[tuple[str, str, str]]) -> list[str]:
    """Return short names of calls, for the tests that are made of them."""
    return [f"{module.removeprefix('mjfish.')}-{function}" for module, _, function in calls]


def spoil(patch: pytest.MonkeyPatch, call: tuple[str, str, str], how: str) -> list[int]:
    """Let a call with numbers fail where the module makes it; return a list that grows by every such call.

    Args:
        patch: undone by the caller.
        call: one of `CALLS`.
        how: ``raises``, or ``no number`` for NaN in place of what it finds.
    """
    module, library, function = call
    importlib.import_module(module)
    owner, calls = importlib.import_module(library), list[int]()
    honest = getattr(owner, function)

    def spoilt(*given: Any, **options: Any) -> Any:
        empty = any(np.size(one) == 0 for one in given if isinstance(one, np.ndarray))  # there is nothing to spoil
        if empty or sys._getframe(1).f_globals["__name__"] != module:
            return honest(*given, **options)
        calls.append(1)
        if how == "raises":
            raise np.linalg.LinAlgError("forced")
        return _no_numbers(honest(*given, **options))

    patch.setattr(owner, function, spoilt)
    return calls


def _no_numbers(found: Any) -> Any:
    """Return what a solver found with NaN in place of its numbers."""
    if isinstance(found, optimize.OptimizeResult):
        x = _no_numbers(found.x)
        return optimize.OptimizeResult({**found, "x": x, "fun": np.nan, "success": False, "status": 2})
    if isinstance(found, tuple):
        parts = [_no_numbers(part) for part in found]
        return type(found)(*parts) if hasattr(found, "_fields") else tuple(parts)
    if isinstance(found, np.ndarray) and not np.issubdtype(found.dtype, np.inexact):
        return found
    return found * np.nan if isinstance(found, np.ndarray | float) else found
