"""How fast it is: ratios, each measured within this one run, so that they mean the same on every machine.

    python tools/bench.py [--json FILE]

A comparison is one function that returns a `Comparison`; add yours to `COMPARISONS`.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from plain_model import PlainModel
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mjfish import fish as fishes
from mjfish import ode, sim
from mjfish.drive import cpg, modes

#: Interleaved repeats of a comparison; the medians count.
REPEATS = 7


@dataclass(frozen=True)
class Side:
    """One side of a comparison: `run` is called `times` times in a row and timed."""

    about: str
    run: Callable[[], object]
    times: int = 1


@dataclass(frozen=True)
class Comparison:
    """Two sides; the ratio is time of `top` over time of `bottom`.

    Attributes:
        top, bottom: the sides.
        target: bound on the ratio.
        at_least: whether the ratio must be above the target, or below it.
        clock: CPU time by default, which a busy machine disturbs least.
    """

    top: Side
    bottom: Side
    target: float
    at_least: bool
    clock: Callable[[], float] = time.process_time

    def met(self, ratio: float) -> bool:
        """Return whether the target is met."""
        return ratio >= self.target if self.at_least else ratio <= self.target


def ode_vs_solve_ivp() -> Comparison:
    """10.4 s of mode v1: compiled, step 5 ms, CPG included, against plain NumPy in scipy; same trajectories."""
    fish = fishes.load("pike")
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


def mujoco_force_euler() -> Comparison:
    """10 s of the swimming fish in MuJoCo, Euler, step 1 ms: with the compiled force, against none."""
    fish = fishes.load("pike")
    model = sim.model(fish, step=0.001, integrator="Euler")
    command = cpg.joint_motion(fish.cpg, modes.drive("v1"), 10.0, 0.01).angle[:, 0]
    data = mujoco.MjData(model)

    def swim() -> None:
        mujoco.mj_resetData(model, data)
        for angles in command:
            data.ctrl[:] = angles
            data.userdata[1:] = np.tile(angles, 3)
            mujoco.mj_step(model, data, 10)
        if not np.abs(data.qvel).max() < 100.0:
            raise SystemExit("mujoco_force_euler: the fish diverged")

    def wet() -> None:
        with sim.installed(model):
            swim()

    return Comparison(
        top=Side("with the force of the water", wet, times=4),
        bottom=Side("the same model without", swim, times=4),
        target=3.0,
        at_least=False,
    )


COMPARISONS: tuple[Callable[[], Comparison], ...] = (ode_vs_solve_ivp, mujoco_force_euler)


def measure(comparison: Comparison, tick: Callable[[], None]) -> tuple[float, float]:
    """Return the median seconds a call of top and bottom, measured in turns."""
    sides = (comparison.top, comparison.bottom)
    seconds: tuple[list[float], list[float]] = ([], [])
    for side in sides:
        side.run()  # compiles, fills caches
    for _ in range(REPEATS):
        for side, taken in zip(sides, seconds, strict=True):
            start = comparison.clock()
            for _ in range(side.times):
                side.run()
            taken.append((comparison.clock() - start) / side.times)
        tick()
    return statistics.median(seconds[0]), statistics.median(seconds[1])


def main() -> int:
    """Measure every comparison; print the table; return 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help='write {"ratios": {name: value}}')
    json_file = parser.parse_args().json
    table = Table(title="Ratios of times: top / bottom")
    for heading in ("name", "top [ms]", "bottom [ms]", "ratio", "target", ""):
        table.add_column(heading, no_wrap=heading != "top [ms]" and heading != "bottom [ms]")
    ratios: dict[str, float] = {}
    good = True
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("bench", total=REPEATS * len(COMPARISONS))
        for make in COMPARISONS:
            comparison = make()
            top, bottom = measure(comparison, lambda: progress.advance(task))
            ratio = ratios[make.__name__] = top / bottom
            met = comparison.met(ratio)
            good = good and met
            table.add_row(
                make.__name__,
                f"{1e3 * top:.3g}  {comparison.top.about}",
                f"{1e3 * bottom:.3g}  {comparison.bottom.about}",
                f"{ratio:.3g}",
                f"{'>=' if comparison.at_least else '<='} {comparison.target:g}",
                "met" if met else "MISSED",
            )
    Console().print(table)
    if json_file is not None:
        json_file.write_text(json.dumps({"ratios": ratios}, indent=2) + "\n", encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
