"""The same readers, under inputs that are led by the branches they reach."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from readers import NAMES

ROOT = Path(__file__).parents[2]
INPUTS = 10_000


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="needs atheris: pip install atheris")
@pytest.mark.parametrize("name", NAMES)
def test_what_leads_to_new_branches_is_read_or_refused(name: str, tmp_path: Path) -> None:
    limits = [f"-runs={INPUTS}", "-seed=1", "-timeout=60", "-rss_limit_mb=850", "-print_final_stats=1"]
    command = [sys.executable, str(Path(__file__).with_name("fuzz.py")), name, str(tmp_path / "fuzzed"), *limits]
    paths = [str(ROOT), str(ROOT / "tests"), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    )
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    assert f"stat::number_of_executed_units: {INPUTS}" in done.stderr
