"""How much an advised run is worth: verdicts split by it against those split by a random run of the menu.

    python -m studies.battery.advised_run --cases 60

Each case draws coefficients, one of two rival causes as the truth, and a noise under which the data at hand hardly tell
the two (lambda of 0.3 to 3). What the advised run and a random one then do is measured, not predicted.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mjfish.data import Dataset, Trial
from mjfish.design import FittedModels, Menu, ModelEstimate, Run, excluded, separations
from mjfish.drive import modes
from mjfish.effects import Effect, find
from mjfish.estimation import fit
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

#: Pairs of rivals and a size of each that is neither small nor large.
PAIRS = {
    ("time_offset", "servo_lag"): ({"time_offset.offset": -0.008}, {"servo_lag.time_constant": 0.01}),
    ("reynolds_drag", "linear_drag"): (
        {"reynolds_drag.friction": 1.0, "reynolds_drag.pressure": 0.3},
        {"linear_drag.along": 1.0, "linear_drag.across": 50.0},
    ),
    ("ambient_current", "frame_misalignment"): ({"ambient_current.y": 0.01}, {"frame_misalignment.angle": 0.03}),
}
TRIALS = ("v1", "v3")
DURATION = 5.0
SIGMA = np.array([0.01, 0.01, 0.05])
#: What the data at hand tell of the pair.
LAMBDA = (0.3, 3.0)
TOLERANCE = 1e-5


@dataclass(frozen=True)
class Outcome:
    """One case: lambda at hand; lambda and probability predicted; verdicts after the advised and after a random run."""

    truth: str
    rival: str
    hardness: float
    advised: str
    random: str
    predicted: float
    probability_advised: float
    probability_random: float
    split_advised: bool
    split_random: bool


def swum(model: Model, truth: dict[str, float], like: Trial, sigma: FloatArray, rng: np.random.Generator) -> Trial:
    """Simulate a trial of the menu with the true values and noise."""
    velocity = model.predict(like, truth).velocity
    return replace(like, velocity=readonly(velocity + sigma * rng.standard_normal(velocity.shape)))


def tells(truth: ModelEstimate, rival: ModelEstimate) -> bool:
    """Whether a verdict drops the rival."""
    return excluded(sse(rival) - sse(truth))


def sse(model_estimate: ModelEstimate) -> float:
    """Return the sum of squared whitened residuals."""
    return float(np.sum(model_estimate.problem.residual(model_estimate.x) ** 2))


def case(seed: int) -> Outcome | None:
    """Draw and play one case; None where the data tell the two apart already."""
    rng = np.random.default_rng([seed, 5])
    names = list(PAIRS)[seed % len(PAIRS)]
    which = int(rng.integers(2))
    truth_name, rival_name = names[which], names[1 - which]
    fish = load_fish("pike")
    model = Model(fish, (find(truth_name),), step=0.005)
    drawn = {name: float(np.exp(rng.uniform(*np.log(_RANGES[name[:3]])))) for name in fish.coefficient_names}
    truth = model.values({**drawn, **PAIRS[names][which]})
    time = readonly(np.arange(int(DURATION * 50) + 1) / 50.0)
    blanks = [Trial(n, "fit", time, readonly(np.zeros((len(time), 3))), modes.drive(n)) for n in TRIALS]
    still = np.zeros(3)
    clean = Dataset("case", fish, tuple(swum(model, truth, b, still, rng) for b in blanks), noise=readonly(SIGMA))
    pair = [find(truth_name), find(rival_name)]
    there = _rivals(clean, pair, truth)
    apart = separations(there, ())[0].noncentrality_of(truth_name)
    wanted = float(np.exp(rng.uniform(*np.log(LAMBDA))))
    sigma = SIGMA * np.sqrt(apart / wanted)
    trials = tuple(swum(model, truth, b, sigma, rng) for b in blanks)
    dataset = Dataset("case", fish, trials, noise=readonly(sigma))
    rivals = _rivals(dataset, pair, truth)
    if tells(rivals[0], rivals[1]) or tells(rivals[1], rivals[0]):
        return None
    runs = Menu(DURATION).runs(dataset)
    (every,) = separations(rivals, runs)
    possible = [i for i in range(len(runs)) if every.runs[i] is not None]
    now = every.noncentrality()
    best = runs[max(possible, key=lambda i: (every.noncentrality(i) - now) / (runs[i].seconds + Menu().pause))]
    other = runs[int(rng.integers(len(runs)))]
    (both,) = separations(rivals, (best, other))
    predicted = [both.probability_of(truth_name, i) for i in range(2)]
    split = [_after(rivals, run, model, truth, sigma, rng) for run in (best, other)]
    return Outcome(
        truth_name, rival_name, wanted, best.name, other.name, both.noncentrality_of(truth_name, 0), *predicted, *split
    )


_RANGES = {"c_m": (0.05, 1.5), "c_d": (0.3, 3.5), "c_f": (0.002, 0.018)}


def _rivals(dataset: Dataset, pair: list[Effect], truth: dict[str, float]) -> tuple[ModelEstimate, ...]:
    """Fit both from the true coefficients: what a fit's start is worth is not asked here."""
    found = []
    for rival, sizes in zip(pair, (truth, {p.name: p.default + p.scale for p in pair[1].parameters}), strict=True):
        problem = FittedModels.undiagnosed(dataset, {}).extended(rival)
        problem = replace(problem, model=replace(problem.model, step=0.01))
        best = fit(problem, problem.start({**truth, **sizes}), tolerance=TOLERANCE)
        found.append(ModelEstimate.of_fit(rival.name, problem, best))
    return tuple(found)


def _after(
    rivals: tuple[ModelEstimate, ...],
    run: Run,
    model: Model,
    truth: dict[str, float],
    sigma: FloatArray,
    rng: np.random.Generator,
) -> bool:
    """Swim the run in the truth, fit both again: whether the truth is told."""
    trial = swum(model, truth, run.trial, sigma, rng)
    again = []
    for rival in rivals:
        problem = replace(rival.problem, trials=(*rival.problem.trials, trial))
        start = problem.start(rival.problem.named(rival.x))
        again.append(ModelEstimate.of_fit(rival.name, problem, fit(problem, start, tolerance=TOLERANCE)))
    return tells(again[0], again[1])


def interval(count: int, total: int) -> str:
    """A proportion with its exact 95 % interval."""
    found = stats.binomtest(count, total).proportion_ci()
    return f"{count}/{total} = {count / total:.2f} ({found.low:.2f} to {found.high:.2f})"


def main() -> None:
    """Play cases and print the tally."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    played: list[Outcome] = []
    for seed in range(given.first, given.first + given.cases):
        one = case(seed)
        print(seed, one, flush=True)
        if one is not None:
            played.append(one)
    n = len(played)
    print("advised:", interval(sum(one.split_advised for one in played), n))
    print("random: ", interval(sum(one.split_random for one in played), n))
    each = ([getattr(one, f"probability_{which}") for one in played] for which in ("advised", "random"))
    print("predicted: {:.2f}, {:.2f}".format(*map(np.mean, each)))


if __name__ == "__main__":
    main()
