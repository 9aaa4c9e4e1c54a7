"""What a first command compiles: every kernel once. A second signature doubles its time and changes nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_TELL = """
import sys
from numba.core.dispatcher import Dispatcher
for name, module in list(sys.modules.items()):
    for thing in list(vars(module).values()) if name.startswith("mjfish.") else ():
        if isinstance(thing, Dispatcher) and thing.py_func.__module__ == name and thing.overloads:
            print("kernel", name, thing.py_func.__name__, len(thing.overloads))
"""
_ENGINE = """
from mjfish.cli.diagnose import DEMO
from mjfish.data import load_dataset
from mjfish.effects.catalogue import catalogue
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.ode.forces import link_forces
from mjfish.ode.jacobians import jacobians
dataset = load_dataset(DEMO)
trial, late = dataset.trials[0], catalogue()["wake_memory"]
for effects, names in (((), ["c_d.head"]), ((late,), ["c_d.head", "start.surge", "wake_memory.share"])):
    model = Model(dataset.fish, effects)
    values = model.values({"wake_memory.share": 0.1} if effects else {})
    run = model.prepare(trial, values)
    rollout = model.predict(trial, values).rollout
    sensitivities(model, trial, values, names)
    jacobians(run.fish, rollout, loads=run.loads)
    link_forces(run.fish, rollout.motion, rollout.at_steps(), loads=run.loads)
"""
_DEMO = """
import sys
from mjfish.cli import main
sys.argv = ["mjfish", "demo", "--out", "out"]
try:
    main()
except SystemExit as done:
    assert not done.code
"""


def _signatures(code: str, folder: Path, cache: str | None = None) -> dict[str, int]:
    """Return how many signatures each kernel has that a fresh process compiled or loaded."""
    environment = os.environ if cache is None else {**os.environ, "NUMBA_CACHE_DIR": cache}
    ran = subprocess.run(
        [sys.executable, "-c", code + _TELL], env=environment, cwd=folder, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    told = [line.split() for line in ran.stdout.splitlines() if line.startswith("kernel ")]
    return {f"{module}.{name}": int(count) for _, module, name, count in told}


def test_simulation_and_derivatives_load_every_kernel_once(tmp_path: Path) -> None:
    """Arrays of one kernel have one layout, whoever calls it."""
    found = _signatures(_ENGINE, tmp_path)
    assert {"mjfish.ode.rollout.integrate", "mjfish.ode.tangents.integrate_tangents"} <= set(found)
    assert {name: count for name, count in found.items() if count > 1} == {}


@pytest.mark.slow
def test_the_demo_of_a_fresh_installation_types_every_function_once(tmp_path: Path) -> None:
    """Parts are compiled with their kernels and seen here only: a cache on disk has the kernels alone."""
    found = _signatures(_DEMO, tmp_path, cache=str(tmp_path / "cache"))
    assert {"mjfish.ode.tangents.integrate_tangents", "mjfish.ode.linearisation.linearise"} <= set(found)
    assert {name: count for name, count in found.items() if count > 1} == {}
