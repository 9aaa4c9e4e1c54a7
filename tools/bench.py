"""How fast it is: ratios, each measured within this one run, so that they mean the same on every machine.

    python tools/bench.py [--scale] [--json FILE]

A comparison is one function that returns a `Comparison`; add yours to `COMPARISONS`. How time and memory grow with the
number of runs is measured in processes of their own (`bench_scale`); ``--scale`` has all rows of that table.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import bench_first_use
import bench_identify
import bench_mujoco
import bench_scale
from comparison import Comparison, Side, measure
from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.execution import executing
from mjfish.fish import load_fish
from plain_model import PlainModel


def ode_vs_solve_ivp() -> Comparison:
    """10.4 s of mode v1: compiled, step 5 ms, CPG included, against plain NumPy in scipy; same trajectories."""
    fish = load_fish("pike")
    segments = modes.drive("v1")
    at = np.linspace(0.0, modes.DURATION, 521)
    plain = PlainModel(fish, segments[0].omega)

    def compiled() -> ode.Rollout:
        cpg.joint_motion.cache_clear()
        return ode.simulate(fish, cpg.joint_motion(fish.cpg, segments, modes.DURATION, 0.005))

    expected = plain.velocity(at)
    difference = np.abs(compiled().at(at)[:, :3] - expected).max(axis=0) / np.ptp(expected, axis=0)
    if not difference.max() < 1e-3:
        raise SystemExit(f"ode_vs_solve_ivp: the two do not swim alike, they differ by {difference} of the range")
    return Comparison(
        top=Side("solve_ivp, RK45, rtol 1e-6, plain NumPy", lambda: plain.velocity(at)),
        bottom=Side("ode.simulate, step 5 ms, and CPG", compiled, times=50),
        target=500.0,
        at_least=True,
    )


COMPARISONS: tuple[Callable[[], Comparison], ...] = (
    ode_vs_solve_ivp,
    *bench_identify.COMPARISONS,
    *bench_mujoco.COMPARISONS,
)


def main() -> int:
    """Measure every comparison; print the table; return 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help='write {"ratios": {name: value}, "missed": [name]}')
    parser.add_argument("--scale", action="store_true", help="more rows of time and memory over the number of runs")
    options = parser.parse_args()
    json_file = options.json
    table = Table(title="Ratios of times: top / bottom")
    for heading in ("name", "top [ms]", "bottom [ms]", "ratio", "target", ""):
        table.add_column(heading, no_wrap=heading != "top [ms]" and heading != "bottom [ms]")
    ratios: dict[str, float] = {}
    missed: list[str] = []
    with executing(1), Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("bench", total=len(COMPARISONS))
        for make in COMPARISONS:
            comparison = make()
            share = 1.0 / comparison.repeats
            top, bottom = measure(comparison, functools.partial(progress.advance, task, share))
            ratio = ratios[make.__name__] = top / bottom
            met = comparison.met(ratio)
            missed += [] if met else [make.__name__]
            table.add_row(
                make.__name__,
                f"{1e3 * top:.3g}  {comparison.top.about}",
                f"{1e3 * bottom:.3g}  {comparison.bottom.about}",
                f"{ratio:.3g}",
                f"{'>=' if comparison.at_least else '<='} {comparison.target:g}",
                "met" if met else "MISSED",
            )
    Console().print(table)
    for name, (seconds, bound) in bench_mujoco.first_use().items():
        missed += [name] if seconds > bound else []
        print(f"{name}: {seconds:.2g} s of at most {bound:g} s: {'met' if seconds <= bound else 'MISSED'}")
    absolute = bench_first_use.compilation() | bench_scale.over_runs(Console(), every=options.scale)
    for name, (value, bound) in absolute.items():
        ratios[name] = value
        missed += [name] if value > bound else []
        print(f"{name}: {value:.3g} of at most {bound:g}: {'met' if value <= bound else 'MISSED'}")
    if json_file is not None:
        json_file.write_text(json.dumps({"ratios": ratios, "missed": missed}, indent=2) + "\n", encoding="utf-8")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
