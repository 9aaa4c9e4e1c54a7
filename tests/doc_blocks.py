"""The code blocks of README and docs: no test, but what tests run them by."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def module(page: Path, name: str) -> ModuleType:
    """Return the Python block that begins with the comment ``# name.py``, run as a module of that name."""
    (source,) = (block for block in blocks(page, "python") if block.startswith(f"# {name}.py\n"))
    made = ModuleType(name)
    exec(compile(source, f"{page.name}: {name}.py", "exec"), made.__dict__)  # noqa: S102 - our own page
    return made
