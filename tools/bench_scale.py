"""Time and memory over runs and samples: `python tools/bench_scale.py WORK KIND RUNS SECONDS RATE` measures one.

    WORK      identify, inspect, diagnose or plan (a cause to be made visible); compare: what a fit does at every point,
              with the errors of the joints and the derivatives
    KIND      driven: from rest, by the CPG; filmed: joint angles measured, each run with a start of its own; seen:
              places, headings and joint angles of a camera, with noise on all
    RUNS      number of runs, every fifth held out
    SECONDS   length of each
    RATE      samples a second

It prints {"seconds": CPU time, "gigabytes": peak of the resident memory, "status": of the result} as one line. CPU time
of one thread, because a shared machine changes the others. The data are made in a process of their own: they are
simulated by steps of 1 ms, which takes more memory than their fit.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
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
from mjfish.estimation.identification import pose
from mjfish.estimation.sensor_noise import with_sensor_noise
from mjfish.execution import executing
from mjfish.execution.executors import processes
from mjfish.fish import Cpg, load_fish
from mjfish.simulation.synthetic import Recording, generate

_MODES = ("v1", "v3", "v5", "v7", "v1-v5", "v5-v1", "v1-t1", "v3-t2")
_NOISE = np.array([0.006, 0.006, 0.05])
#: Of places [m], headings and joint angles [rad].
_SEEN, _JOINTS = np.array([0.001, 0.001, 0.01]), 0.005
#: A film begins this late [s]: the fish swims already.
_LATE = 1.0
#: What is hidden in the data.
_HIDDEN = {"fin_lift.slope": 1.0}


def _compared(dataset: Dataset) -> str:
    problem = pose(dataset)
    x = problem.start()
    problem = with_sensor_noise(problem, x)
    with executing(1):
        problem.residual(x)
        problem.jacobian(x).factorised()
    return f"{problem.measured} numbers"


WORKS: dict[str, Callable[[Dataset], str]] = {
    "identify": lambda dataset: mjfish.identify(dataset, starts=4, jobs=1).fit.status,
    "inspect": lambda dataset: f"{len(mjfish.inspect(dataset).findings)} findings",
    "diagnose": lambda dataset: mjfish.diagnose(dataset, jobs=1).verdict,
    "plan": lambda dataset: plan(dataset, causes=["fin_lift"], jobs=1).status,
    "compare": _compared,
}


@dataclass(frozen=True)
class Size:
    """How much data: number of runs, length of each [s], samples a second."""

    runs: int
    seconds: float = 10.0
    rate: float = 50.0

    @property
    def samples(self) -> float:
        """Number of samples of all runs."""
        return self.runs * self.seconds * self.rate


@dataclass(frozen=True)
class Scaled:
    """What one piece of work takes with so much data."""

    size: Size
    seconds: float
    gigabytes: float
    status: str


def measured(work: str, kind: str, size: Size) -> Scaled:
    """Measure one piece of work in a process of its own."""
    call = [sys.executable, __file__, work, kind, *map(str, (size.runs, size.seconds, size.rate))]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(call, check=True, capture_output=True, text=True, env=environment)
    return Scaled(size, **json.loads(done.stdout.splitlines()[-1]))


#: Most times that four times the runs may take, and most memory [GB].
_RATIO, _MEMORY = 4.6, 2.0
#: Pieces of work and sizes: those that are always measured, and those of the whole table.
_RUNS = tuple(Size(runs) for runs in (20, 80))
_HOUR = (Size(1, 3600.0, 100.0),)
_QUARTERS = ((Size(15, 60.0, 100.0), Size(60, 60.0, 100.0)), (Size(1, 900.0, 100.0), *_HOUR))
_SEEN_HOURS = tuple(("compare", "seen", sizes) for sizes in _QUARTERS)
_SHORT = (("identify", "driven", _RUNS), ("diagnose", "driven", _RUNS), *_SEEN_HOURS)
_ALL_RUNS = tuple(Size(runs) for runs in (5, 20, 80, 500))
_LONG = tuple(Size(2, seconds) for seconds in (10.0, 100.0, 1000.0))
_MORE = (
    ("identify", "driven", _ALL_RUNS),
    ("identify", "filmed", _ALL_RUNS),
    ("inspect", "driven", _ALL_RUNS),
    ("diagnose", "driven", _ALL_RUNS[:3]),
    ("plan", "driven", _ALL_RUNS),
    ("identify", "filmed", _LONG),
    ("inspect", "filmed", _LONG),
    ("plan", "filmed", _LONG),
    ("diagnose", "filmed", _LONG[:2]),
    ("identify", "filmed", _HOUR),
    ("inspect", "filmed", _HOUR),
    *_SEEN_HOURS,
)


def over_runs(console: Console, *, every: bool) -> dict[str, tuple[float, float]]:
    """Print time and memory over the size of the data; return ratios and memory by name, each with its bound.

    Args:
        console: where the table goes.
        every: all rows, not only those that have names.
    """
    table = Table(title="CPU time and memory over the size of the data")
    for heading in ("work", "runs", "of [s]", "time [s]", "ratio", "exponent", "memory [GB]", "status"):
        table.add_column(heading, no_wrap=True)
    found = {}
    for work, kind, sizes in _MORE if every else _SHORT:
        before: Scaled | None = None
        for row in (measured(work, kind, size) for size in sizes):
            power = (
                ("", "") if before is None else (f"{row.seconds / before.seconds:.3g}", f"{_exponent(before, row):.2f}")
            )
            size = (str(row.size.runs), f"{row.size.seconds:g}")
            table.add_row(f"{work}, {kind}", *size, f"{row.seconds:.3g}", *power, f"{row.gigabytes:.2f}", row.status)
            if kind == "driven" and work in ("identify", "diagnose") and row.size.runs == 80 and before is not None:
                found[f"{work}_80_over_20"] = (row.seconds / before.seconds, _RATIO)
                found[f"{work}_80_gb"] = (row.gigabytes, _MEMORY)
            if work == "compare" and before is not None:
                found[f"compare_{row.size.runs}_times_4"] = (row.seconds / before.seconds, _RATIO)
            if row.size in (_ALL_RUNS[-1], *_HOUR, _QUARTERS[0][-1]):
                length = "hour" if row.size.runs == 1 else str(row.size.runs)
                found[f"{work}_{kind}_{length}_gb"] = (row.gigabytes, _MEMORY)
            before = row
    console.print(table)
    return found


def _exponent(small: Scaled, large: Scaled) -> float:
    """Return by which power of the number of samples the time grows."""
    return math.log(large.seconds / small.seconds) / math.log(large.size.samples / small.size.samples)


def dataset(kind: str, size: Size) -> Dataset:
    """Return synthetic runs of the pike in which fins lift; every fifth is held out."""
    fish = load_fish("pike")
    names = [_MODES[i % len(_MODES)] for i in range(size.runs)]
    seen: Recording = {"observe": "pose", "joints": "measured", "joint_noise": _JOINTS} if kind == "seen" else {}
    found = generate(
        fish, names, values=_HIDDEN, effects=[find("fin_lift")], noise=_SEEN if kind == "seen" else _NOISE, seed=1,
        duration=size.seconds, rate=size.rate, **seen,
    )  # fmt: skip
    trials = [replace(trial, role="held_out" if i % 5 == 4 else "fit") for i, trial in enumerate(found.trials)]
    return replace(found, trials=tuple(_filmed(fish.cpg, t) if kind == "filmed" else t for t in trials))


def _filmed(rhythm: Cpg | None, trial: Trial) -> Trial:
    assert rhythm is not None  # noqa: S101 - the pike has one
    motion = cpg.joint_motion(rhythm, trial.drive, float(trial.time[-1]), 0.005)
    kept = trial.time >= _LATE
    time_ = trial.time[kept]
    return replace(
        trial, drive=(), time=time_ - _LATE, velocity=trial.velocity[kept], joint_angle=motion.angle_at(time_)
    )


def main(arguments: Sequence[str]) -> None:
    """Measure the piece of work that the command line names."""
    work, kind, *numbers = arguments
    runs, seconds, rate = map(float, numbers)
    with processes(1) as other:
        data = other.submit(dataset, kind, Size(int(runs), seconds, rate)).result()
    mjfish.identify(dataset(kind, Size(3)), starts=1)  # compiled, once
    start = time.process_time()
    status = WORKS[work](data)
    spent = time.process_time() - start
    print(json.dumps({"seconds": spent, "gigabytes": peak_megabytes() * 2**20 / 1e9, "status": status}))


if __name__ == "__main__":
    main(sys.argv[1:])
