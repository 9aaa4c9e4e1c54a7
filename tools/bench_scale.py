"""Time and memory over the number of runs: `python tools/bench_scale.py WORK KIND RUNS` measures one, in its process.

    WORK   identify, inspect, diagnose or plan
    KIND   driven: from rest, by the CPG; filmed: joint angles measured, each run with a start of its own
    RUNS   of 10 s at 50 Hz

It prints {"seconds": s, "gigabytes": peak of the resident memory, "status": of the result} as one line.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

import mjfish
from fit_cost import peak_megabytes
from mjfish.data import Dataset, Trial
from mjfish.design import plan
from mjfish.drive import cpg
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.simulation.synthetic import generate

_MODES = ("v1", "v3", "v5", "v7", "v1-v5", "v5-v1", "v1-t1", "v3-t2")
_NOISE = np.array([0.006, 0.006, 0.05])
_SECONDS = 10.0
#: A film begins this late [s]: the fish swims already.
_LATE = 1.0
#: What is hidden in the data.
_HIDDEN = {"fin_lift.slope": 1.0}
WORKS: dict[str, Callable[[Dataset], str]] = {
    "identify": lambda dataset: mjfish.identify(dataset, starts=4).fit.status,
    "inspect": lambda dataset: f"{len(mjfish.inspect(dataset).findings)} findings",
    "diagnose": lambda dataset: mjfish.diagnose(dataset).verdict,
    "plan": lambda dataset: plan(dataset).status,
}


@dataclass(frozen=True)
class Scaled:
    """What one piece of work takes with so many runs."""

    work: str
    kind: str
    runs: int
    seconds: float
    gigabytes: float
    status: str


def measured(work: str, kind: str, runs: int) -> Scaled:
    """Measure one piece of work in a process of its own."""
    done = subprocess.run([sys.executable, __file__, work, kind, str(runs)], check=True, capture_output=True, text=True)
    return Scaled(work, kind, runs, **json.loads(done.stdout.splitlines()[-1]))


#: Pieces of work, kinds and numbers of runs: those that are always measured, and those of the whole table.
_SHORT = (("identify", "driven", (20, 80)), ("diagnose", "driven", (20, 80)))
_MORE = (
    ("inspect", "driven", (20, 80)),
    ("plan", "driven", (20, 80)),
    ("identify", "filmed", (20, 80)),
    ("diagnose", "filmed", (20, 80)),
    ("identify", "filmed", (500,)),
)
#: Most times that four times the runs may take, and most memory [GB].
_RATIO, _MEMORY = 4.6, 2.0


def over_runs(console: Console, *, every: bool) -> dict[str, tuple[float, float]]:
    """Print time and memory over the number of runs; return ratios and memory by name, each with its bound.

    Args:
        console: where the table goes.
        every: all rows, not only those that have names.
    """
    table = Table(title="Time and memory over the number of runs of 10 s at 50 Hz")
    for heading in ("work", "runs", "time [s]", "memory [GB]", "exponent", "status"):
        table.add_column(heading, no_wrap=True)
    found = {}
    for work, kind, sizes in (*_SHORT, *(_MORE if every else ())):
        rows = [measured(work, kind, runs) for runs in sizes]
        for row in rows:
            power = f"{exponent(rows[0], row):.2f}" if row is not rows[0] else ""
            numbers = (f"{row.seconds:.3g}", f"{row.gigabytes:.2f}", power, row.status)
            table.add_row(f"{work}, {kind}", str(row.runs), *numbers)
        if kind == "driven" and work in ("identify", "diagnose"):
            small, large = rows
            found[f"{work}_80_over_20"] = (large.seconds / small.seconds, _RATIO)
            found[f"{work}_80_gb"] = (large.gigabytes, _MEMORY)
    console.print(table)
    return found


def exponent(small: Scaled, large: Scaled) -> float:
    """Return by which power of the number of runs the time grows."""
    return math.log(large.seconds / small.seconds) / math.log(large.runs / small.runs)


def dataset(kind: str, runs: int) -> Dataset:
    """Return synthetic runs of the pike in which fins lift; every fifth is held out."""
    fish = load_fish("pike")
    names = [_MODES[i % len(_MODES)] for i in range(runs)]
    found = generate(fish, names, values=_HIDDEN, effects=[find("fin_lift")], noise=_NOISE, seed=1, duration=_SECONDS)
    trials = [replace(trial, role="held_out" if i % 5 == 4 else "fit") for i, trial in enumerate(found.trials)]
    return replace(found, trials=tuple(_filmed(fish.cpg, t) if kind == "filmed" else t for t in trials))


def _filmed(rhythm: object, trial: Trial) -> Trial:
    motion = cpg.joint_motion(rhythm, trial.drive, _SECONDS, 0.005)  # type: ignore[arg-type]
    kept = trial.time >= _LATE
    time_ = trial.time[kept]
    return replace(
        trial, drive=(), time=time_ - _LATE, velocity=trial.velocity[kept], joint_angle=motion.angle_at(time_)
    )


def main() -> None:
    """Measure the piece of work that the command line names."""
    work, kind, runs = sys.argv[1:]
    mjfish.identify(dataset(kind, 3), starts=1)  # compiled, once
    data = dataset(kind, int(runs))
    start = time.perf_counter()
    status = WORKS[work](data)
    seconds = time.perf_counter() - start
    peak = peak_megabytes() * 2**20 / 1e9
    print(json.dumps({"seconds": seconds, "gigabytes": peak, "status": status}))


if __name__ == "__main__":
    main()
