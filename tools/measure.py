"""Count what the package holds, and hold it to the limits in pyproject.toml; part of `make check`.

    python tools/measure.py

Counted are statements (`ast.stmt`, docstrings left out) and the parameters of every function, ``self`` among them.
"""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Limits:
    """The table ``[tool.measure]`` of pyproject.toml.

    Attributes:
        package: folder that is measured, relative to pyproject.toml.
        statements: at most so many in the package.
        parameters: at most so many of a function.
        kernel_parameters: at most so many of a compiled function.
        kernel_decorators: names that compile a function, as a decorator or called with it.
        unlimited: folders whose functions may have any number of parameters.
    """

    package: str
    statements: int
    parameters: int
    kernel_parameters: int
    kernel_decorators: tuple[str, ...]
    unlimited: tuple[str, ...]

    @classmethod
    def read(cls, pyproject: Path) -> Limits:
        """Read the limits."""
        table = tomllib.loads(pyproject.read_text(encoding="utf-8"))["tool"]["measure"]
        plain: dict[str, Any] = {key.replace("-", "_"): value for key, value in table.items()}
        return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in plain.items()})


@dataclass(frozen=True)
class Function:
    """One function: its name, line, number of parameters, and whether it is compiled."""

    name: str
    line: int
    parameters: int
    kernel: bool


def statements(tree: ast.Module) -> int:
    """Return the number of statements; strings that stand alone, docstrings among them, are none."""
    return sum(isinstance(node, ast.stmt) and not _is_string(node) for node in ast.walk(tree))


def functions(tree: ast.Module, kernel_decorators: tuple[str, ...]) -> Iterator[Function]:
    """Yield every function of a module, methods and nested ones too."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and _name(node.func) in kernel_decorators]
    compiled = {argument.id for call in calls for argument in call.args if isinstance(argument, ast.Name)}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {_name(decorator) for decorator in node.decorator_list}
            kernel = node.name in compiled or not decorators.isdisjoint(kernel_decorators)
            yield Function(node.name, node.lineno, _parameters(node.args), kernel)


def excesses(root: Path, limits: Limits) -> tuple[Counter[str], list[str]]:
    """Return the statements by folder or file below the package, and a line for each limit that is exceeded."""
    found: Counter[str] = Counter()
    lines: list[str] = []
    package = root / limits.package
    for path in sorted(package.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found[path.relative_to(package).parts[0]] += statements(tree)
        if any(path.is_relative_to(root / folder) for folder in limits.unlimited):
            continue
        for function in functions(tree, limits.kernel_decorators):
            limit = limits.kernel_parameters if function.kernel else limits.parameters
            if function.parameters > limit:
                kind = "compiled function" if function.kernel else "function"
                lines.append(
                    f"{path.relative_to(root)}:{function.line}: {kind} {function.name} has {function.parameters} "
                    f"parameters, at most {limit} are allowed; group those that belong together in a dataclass"
                )
    if found.total() > limits.statements:
        lines.append(f"{limits.package}: {found.total()} statements, at most {limits.statements} are allowed")
    return found, lines


def _parameters(arguments: ast.arguments) -> int:
    listed = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    return len(listed) + (arguments.vararg is not None) + (arguments.kwarg is not None)


def _is_string(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _name(node: ast.expr) -> str:
    """Return the last name of ``a``, ``a.b``, ``a(...)``."""
    if isinstance(node, ast.Call):
        return _name(node.func)
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def main() -> int:
    """Print the counts and what exceeds a limit; return the exit code."""
    limits = Limits.read(ROOT / "pyproject.toml")
    found, lines = excesses(ROOT, limits)
    parts = ", ".join(f"{name} {count}" for name, count in found.most_common())
    print(f"{limits.package}: {found.total()} statements, limit {limits.statements} ({parts})")
    for line in lines:
        print(line)
    return 1 if lines else 0


if __name__ == "__main__":
    raise SystemExit(main())
