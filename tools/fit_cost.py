"""What a fit costs in time and memory, over trials and over free parameters, as Markdown.

    python tools/fit_cost.py [--trials 1 2 5 10 20] [--free 1 2 3 4 5 6 7 8 9]

Synthetic trials in the modes of Table IV, 10.4 s at 50 Hz; one thread. Each fit has a process of its own, which
gives the peak of its memory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mjfish.drive import modes
from mjfish.estimation import Noise, Problem, fit
from mjfish.execution import executing
from mjfish.fish import load_fish
from mjfish.model import Model, Prediction, Prepared
from mjfish.simulation.synthetic import generate

_SIGMA = np.array([0.01, 0.01, 0.05])
#: Inside the bounds of Table III, away from its start values: c_m, c_d, c_f of head, body, tail.
_TRUTH = dict(zip(load_fish("pike").coefficient_names, (0.5, 0.6, 0.4, 1.5, 1.2, 1.6, 0.01, 0.008, 0.012), strict=True))
#: In this order parameters are set free: those first that the data know best.
_ORDER = ("c_d.tail", "c_m.tail", "c_d.body", "c_m.body", "c_d.head", "c_m.head", "c_f.tail", "c_f.head", "c_f.body")
TRIALS = (1, 2, 5, 10, 20)
FREE = tuple(range(1, len(_ORDER) + 1))


@dataclass(frozen=True)
class Cost:
    """What one fit took.

    Attributes:
        trials, free: its size.
        status: of the fit.
        evaluations: of the residual by the optimiser, most of them followed by one of its derivatives.
        rollouts: simulations of one trial.
        slopes: simulations of one trial with its derivatives by all parameters.
        seconds: CPU time, without compilation.
        megabytes: most memory that the process ever had.
    """

    trials: int
    free: int
    status: str
    evaluations: int
    rollouts: int
    slopes: int
    seconds: float
    megabytes: float


class CountedModel(Model):
    """The model; counts the rollouts that are asked of it."""

    predicted: ClassVar[int] = 0
    prepared: ClassVar[int] = 0

    def predict(self, *arguments: Any, **named: Any) -> Prediction:
        """Return the prediction of a trial."""
        CountedModel.predicted += 1
        return super().predict(*arguments, **named)

    def prepare(self, *arguments: Any, **named: Any) -> Prepared:
        """Return what is simulated: every rollout begins here, predictions and derivatives."""
        CountedModel.prepared += 1
        return super().prepare(*arguments, **named)


def fitted(trials: int, free: int, duration: float = modes.DURATION) -> Cost:
    """Fit `free` coefficients to `trials` synthetic trials, the modes in turn, in this process."""
    names = [modes.MODES[k % len(modes.MODES)] for k in range(trials)]
    fish = load_fish("pike")
    synthetic = generate(fish, names, values=_TRUTH, noise=_SIGMA, duration=duration, seed=1)
    fixed = {name: _TRUTH[name] for name in _ORDER[free:]}
    problem = Problem(CountedModel(fish), synthetic.trials, Noise.white(_SIGMA), fixed=fixed)
    problem.residual(problem.start())  # compiles, as does the next
    problem.jacobian(problem.start())
    CountedModel.predicted = CountedModel.prepared = 0
    start = time.process_time()
    with executing(1):
        found = fit(problem)
    return Cost(
        trials=trials,
        free=free,
        status=found.status,
        evaluations=found.evaluations,
        rollouts=CountedModel.predicted,
        slopes=CountedModel.prepared - CountedModel.predicted,
        seconds=time.process_time() - start,
        megabytes=peak_megabytes(),
    )


def peak_megabytes() -> float:
    """Return the peak of this process's memory; Linux counts that of the parent into ``ru_maxrss``."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM"))
        return float(line.split()[1]) / 1024.0
    import resource  # there is none on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def alone(trials: int, free: int, duration: float = modes.DURATION) -> Cost:
    """Fit in a process of its own."""
    call = f"import json, fit_cost; print(json.dumps(vars(fit_cost.fitted({trials}, {free}, {duration}))))"
    ran = subprocess.run(
        [sys.executable, "-c", call],
        cwd=Path(__file__).parent,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # idle threads of BLAS wait busily
        check=True,
        capture_output=True,
        text=True,
    )
    return Cost(**json.loads(ran.stdout))


def markdown(costs: Sequence[Cost]) -> str:
    """Return a table. The time of an evaluation and trial stays the same where cost is linear in trials."""
    heads = ("trials", "free", "evaluations", "rollouts", "derivatives", "CPU time [s]", "an evaluation and trial [ms]")
    rows = [
        f"| {c.trials} | {c.free} | {c.evaluations} | {c.rollouts} | {c.slopes} | {c.seconds:.2f} "
        f"| {1e3 * c.seconds / (c.evaluations * c.trials):.1f} | {c.megabytes:.0f} |"
        for c in costs
    ]
    return "\n".join([f"| {' | '.join(heads)} | peak memory [MB] |", "|--:" * (len(heads) + 1) + "|", *rows])


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, nargs="*", default=list(TRIALS), metavar="N")
    parser.add_argument("--free", type=int, nargs="*", default=list(FREE), metavar="N")
    asked = parser.parse_args()
    print("Nine free coefficients, more and more trials:\n")
    print(markdown([alone(trials, len(_ORDER)) for trials in asked.trials]))
    print("\nTwo trials, more and more free coefficients:\n")
    print(markdown([alone(2, free) for free in asked.free]))


if __name__ == "__main__":
    main()
