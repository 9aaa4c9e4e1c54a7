"""The commands and the Python of docs/plan.md run as they stand there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

from doc_blocks import ROOT, blocks


def _run(command: str, folder: Path) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command, shell=True, cwd=folder, capture_output=True, text=True, env={**os.environ, "PATH": path}, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_the_page_of_the_next_experiment_runs(tmp_path: Path) -> None:
    """Bench first, the best repeat in the table and below the best run, a folder that lacks one recording."""
    page = ROOT / "docs" / "plan.md"
    (tmp_path / "out").mkdir()
    told = [_run(command, tmp_path) for command in blocks(page, "sh")[0].splitlines()][1]
    assert "First sync-flash" in told
    assert "v1-again" in told
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    runs = [option for option in plan["options"] if option["kind"] == "run"]
    repeat = next(option for option in runs if option["name"] == "v1-again")
    pair, again = (option["pairs"][0] for option in (runs[0], repeat))
    assert again["probability_now"] < 0.01
    assert pair["probability_after"] > 0.9 > again["probability_after"]
    named = tomllib.loads((tmp_path / "out" / "next" / "dataset.toml").read_text())["trials"][-1]
    assert named["name"] == runs[0]["name"]
    assert not (tmp_path / "out" / "next" / named["file"]).exists()
    assert named["file"] in (tmp_path / "out" / "next" / "RECORD.md").read_text()
    (script,) = blocks(page, "python")
    (tmp_path / "own.py").write_text(script)
    assert _run("python own.py", tmp_path).endswith(" True\n")
