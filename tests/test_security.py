"""What SECURITY.md promises of the code: no network, and code from nowhere but from files that are named for it."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mjfish
from mjfish.cli.diagnose import DEMO

_PACKAGE = Path(mjfish.__file__).parent
_NETWORK = {
    "socket",
    "ssl",
    "http",
    "urllib",
    "ftplib",
    "smtplib",
    "asyncio",
    "requests",
    "httpx",
    "aiohttp",
    "webbrowser",
}
_UNSAFE = {"pickle", "marshal", "shelve", "runpy", "code", "yaml", "joblib", "dill", "cloudpickle"}
#: Where the promise allows it.
_RUNS_FILES = {"files/user_code.py"}
#: What goes to workers and comes back from them.
_SENDS = {"execution/tasks.py", "hydro/load.py", "effects/catalogue.py"}
_RUNS_PROGRAMS = {"reporting/log/reading.py", "diagnosis/provenance.py"}


def _trees() -> Iterator[tuple[str, ast.AST]]:
    for file in sorted(_PACKAGE.rglob("*.py")):
        yield file.relative_to(_PACKAGE).as_posix(), ast.parse(file.read_text(encoding="utf-8"))


def _imported(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {part for name in names for part in (name, name.split(".")[0])}


def _called(tree: ast.AST) -> set[str]:
    calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return {
        call.id if isinstance(call, ast.Name) else call.attr
        for call in calls
        if isinstance(call, ast.Name | ast.Attribute)
    }


def test_no_module_imports_what_opens_a_connection_or_runs_data() -> None:
    found = {name: (_NETWORK | _UNSAFE) & _imported(tree) for name, tree in _trees()}
    used = {name: modules for name, modules in found.items() if modules}
    assert used == {name: {"cloudpickle"} for name in _SENDS}


def test_only_named_modules_run_files_and_programs() -> None:
    trees = dict(_trees())
    running = {
        name for name, tree in trees.items() if {"exec", "eval", "exec_module", "system", "popen"} & _called(tree)
    }
    assert running == _RUNS_FILES
    assert {name for name, tree in trees.items() if "subprocess" in _imported(tree)} == _RUNS_PROGRAMS
    shells = [
        keyword
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "shell"
    ]
    assert not shells


def test_no_connection_is_opened_while_a_dataset_is_read_and_shown(tmp_path: Path) -> None:
    """By the interpreter's own audit, libraries included: names are not looked up, nothing is connected to."""
    script = (
        "import sys\n"
        "def watch(event, args):\n"
        "    if event.startswith(('socket.connect', 'socket.getaddrinfo', 'socket.sendto', 'urllib')):\n"
        "        sys.stderr.write(f'opened: {event} {args}\\n')\n"
        "        sys.exit(7)\n"
        "sys.addaudithook(watch)\n"
        "import mjfish\n"
        f"result = mjfish.inspect({str(DEMO)!r})\n"
        f"result.report({str(tmp_path / 'page.html')!r})\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "default-src 'none'" in (tmp_path / "page.html").read_text(encoding="utf-8")
