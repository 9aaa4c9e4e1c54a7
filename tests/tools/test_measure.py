"""`tools/measure.py`: statements and parameters are counted right, and limits are held."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from measure import ROOT, Function, Limits, excesses, functions, statements

MODULE = '''"""Docstring."""
from numba import njit
import tools

class A:
    """Docstring."""

    x: int = 1

    def method(self, a, b=1, *rest, c, **more):
        """Docstring."""
        if a:
            return b

@tools.compiled(cached=True)
def kernel(a, b, c): ...

def late(a, b, /, c): ...

fast = compiled(late)
'''


def test_docstrings_are_no_statements() -> None:
    # two imports, class, x, method, if, return, kernel with its body, late with its body, fast
    assert statements(ast.parse(MODULE)) == 12


def test_every_kind_of_parameter_counts_and_kernels_are_known_by_decorator_or_call() -> None:
    assert set(functions(ast.parse(MODULE), ("compiled",))) == {
        Function("method", 10, 6, kernel=False),
        Function("kernel", 16, 3, kernel=True),
        Function("late", 18, 3, kernel=True),
    }


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, []),
        ({"statements": 11}, ["package: 12 statements, at most 11"]),
        ({"parameters": 5}, ["package/part/a.py:10: function method has 6 parameters, at most 5"]),
        ({"parameters": 5, "unlimited": ("package/part",)}, []),
        ({"kernel_parameters": 2}, ["a.py:16: compiled function kernel has 3", "a.py:18: compiled function late"]),
    ],
)
def test_what_exceeds_a_limit_is_named_with_its_place(
    tmp_path: Path, changed: dict[str, object], found: list[str]
) -> None:
    (tmp_path / "package" / "part").mkdir(parents=True)
    (tmp_path / "package" / "part" / "a.py").write_text(MODULE)
    limits = {"statements": 12, "parameters": 6, "kernel_parameters": 3, "unlimited": (), **changed}
    counts, lines = excesses(tmp_path, Limits(package="package", kernel_decorators=("compiled",), **limits))  # type: ignore[arg-type]
    assert counts == {"part": 12}
    assert len(lines) == len(found)
    assert all(text in line for text, line in zip(found, lines, strict=True))


def test_the_package_keeps_its_limits() -> None:
    _, lines = excesses(ROOT, Limits.read(ROOT / "pyproject.toml"))
    assert lines == []
