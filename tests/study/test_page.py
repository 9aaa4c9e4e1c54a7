"""The page of studies: its file, its commands, and stand-ins for SLURM and Snakemake."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import ROOT, blocks, commands, run_command
from small_study import contents

PAGE = ROOT / "docs" / "study.md"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the commands of the page have run."""
    folder = tmp_path_factory.mktemp("page")
    (study,) = blocks(PAGE, "toml")
    (folder / "study.toml").write_text(study)
    (folder / "out").mkdir()
    made, ran, collected = (run_command(line, folder) for line in commands(PAGE)[:3])
    assert "with 2 trials" in made
    assert "0 pieces were there, 4 were made, 0 of all failed" in ran
    assert "lagging, drag: 2 converged" in collected
    assert "study.csv, summary.txt" in collected
    (shown,) = re.findall(r"The columns of `study.csv`: (.*?)then every estimate", PAGE.read_text(), re.DOTALL)
    header = (folder / "out" / "study" / "study.csv").read_text().partition("\n")[0].replace('"', "").split(",")
    assert header[:10] == [name for name in re.findall(r"`(\w+)`", shown) if name not in ("failed", "open")]
    return folder


def _bash(script: str, folder: Path, **variables: str) -> str:
    """Run a script in bash; `mjfish` is this one."""
    bin_ = folder / "bin"
    bin_.mkdir(exist_ok=True)
    (bin_ / "mjfish").write_text(f'#!/bin/sh\nexec {sys.executable} -c "from mjfish.cli import main; main()" "$@"\n')
    (bin_ / "mjfish").chmod(0o755)
    paths = {"PATH": f"{bin_}:{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run(
        ["bash", "-c", script], cwd=folder, env={**os.environ, **paths, **variables}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_shares_by_a_loop_of_the_shell_make_the_same_bytes(folder: Path) -> None:
    loop, _ = blocks(PAGE, "bash")
    assert "4 of 4 pieces are done" in _bash(loop, folder)
    assert contents(folder / "out" / "shares") == contents(folder / "out" / "study")


def test_the_script_of_slurm_makes_the_same_bytes(folder: Path) -> None:
    """With a loop in the place of its array."""
    _, script = blocks(PAGE, "bash")
    (first, last) = re.findall(r"--array=(\d+)-(\d+)", script)[0]
    for task in range(int(first), int(last) + 1):
        _bash(script, folder, SLURM_ARRAY_TASK_ID=str(task), SLURM_ARRAY_TASK_COUNT=last)
    assert contents(folder / "out" / "slurm") == contents(folder / "out" / "study")
    (collecting,) = re.findall(r'--wrap "(.*?)"', PAGE.read_text())
    assert "4 of 4 pieces are done" in run_command(collecting, folder)


def test_the_rules_of_snakemake_make_the_same_bytes(folder: Path) -> None:
    """With their commands, one after the other, in the place of Snakemake."""
    (rules,) = blocks(PAGE, "python")
    (shares,) = re.findall(r"^SHARES = (\d+)", rules, re.MULTILINE)
    collecting, share = re.findall(r'shell: "(.*?)"', rules)
    for shard in range(1, int(shares) + 1):
        run_command(share.replace("{wildcards.shard}", str(shard)) + shares, folder)
    assert "4 of 4 pieces are done" in run_command(collecting, folder)
    assert contents(folder / "out" / "snake") == contents(folder / "out" / "study")
