"""How far the clock of the drive wanders: a walk of time w(t) whose modes are parameters of every run.

Whether there is one is asked of the residual that coefficients and candidates leave, by restricted likelihood. A time w
by which the drive is ahead moves every joint by theta' w, its rate by (theta' w)', its acceleration by (theta' w)''. The
equation of motion, linearised along the rollout, carries that to the velocities:

    dv' = A(t) dv + B(t) (theta' w, (theta' w)', (theta' w)'')

If there is one, its modes are fitted, a_m ~ N(0, size^2), and the size is that of the largest marginal likelihood, by
the step of [Wood2017] sec. 6.6 with the covariance C of the modes:

    size^2  <-  sum_m a_m^2 / sum_m (1 - C_mm / size^2)

[Wood2017] S. Wood, Generalized Additive Models (2nd ed.).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from mjfish.arrays import FloatArray, readonly
from mjfish.block_angular import block_angular
from mjfish.data import Trial
from mjfish.drive.walk import count, modes
from mjfish.estimation.clocks import WALK
from mjfish.estimation.fit import Fit, fit_or_raise
from mjfish.estimation.problem import Problem
from mjfish.frames import CHANNELS
from mjfish.noise import ErrorsInVariables, Noise, NoiseSample
from mjfish.ode.jacobians import jacobians, linear_response

#: Sizes that are tried [s^0.5].
_TRIED = (1e-3, 4e-3, 1.6e-2, 6.4e-2)
#: Log-likelihood that a walk must gain: a p value of 8e-6 for one number more.
CLEAR = 10.0
#: Share of the size that is left without any one run. Of 2000 draws of five runs with ten modes each, the least is 0.73.
_SHARE = 0.5
#: Rounds of the size, a relative change of it that ends them, and a size [s^0.5] that is none.
_ROUNDS, _SAME, _NOTHING = 6, 0.03, 1e-5


@dataclass(frozen=True, eq=False)
class LinearWalk:
    """What a walk of the clock does to the velocities of a fit, to first order.

    Attributes:
        problem: that was fitted.
        values: its parameters by name.
    """

    problem: Problem
    values: Mapping[str, float]
    _cache: dict[str, FloatArray] = field(default_factory=dict)

    def modes(self, trial: Trial) -> FloatArray:
        """Return what the modes of a walk of one s^0.5 do (n, 3, modes), at all samples."""
        return self._responses(trial)[:, :, 2:]

    def levels(self, trial: Trial) -> FloatArray:
        """Return what an offset of the clock and a wrong frequency do (n, 3, 2)."""
        return self._responses(trial)[:, :, :2]

    def _responses(self, trial: Trial) -> FloatArray:
        """Return `levels`, then `modes`; nothing of a run that diverges, for nothing is linear about it."""
        if trial.name in self._cache:
            return self._cache[trial.name]
        run = self.problem.model.prepare(trial, self.values)
        rollout = self.problem.prediction(trial, self.values).rollout
        if rollout.message or trial.joints_measured:
            return np.zeros((len(trial.time), len(CHANNELS), 3))
        a, b = jacobians(run.fish, rollout, values=run.coefficients, loads=run.loads)
        time = rollout.time[: len(a)]
        rate, second = (part[: len(a), :1] for part in (rollout.motion.rate, rollout.motion.acceleration))
        third = np.gradient(second, time, axis=0)
        by_angle, by_rate, by_acceleration = b.transpose(2, 0, 1, 3)
        push = (
            by_angle * rate + by_rate * second + by_acceleration * third,
            by_rate * rate + 2.0 * by_acceleration * second,
            by_acceleration * rate,
        )
        start, end = float(time[0]), float(time[-1])
        since, still = time - start, np.zeros_like(time)
        levels = np.stack([still + 1.0, since]), np.stack([still, still + 1.0]), np.zeros((2, len(time)))
        walks = modes(time, start, end, count(end - start))
        forcing = sum(
            part.sum(axis=2)[:, :, None] * np.concatenate([level.T, walk], axis=1)[:, None]
            for part, level, walk in zip(push, levels, walks, strict=True)
        )
        found = np.asarray(make_interp_spline(time, linear_response(a, forcing, time), k=3)(trial.time))
        smoothing = self.problem.smoothing
        self._cache[trial.name] = readonly(found if smoothing is None else smoothing.of_trial(trial, found))
        return self._cache[trial.name]


def first_size(
    walk: LinearWalk, left: NoiseSample, plain: Noise, select: Callable[[NoiseSample], tuple[Noise, str]]
) -> float:
    """Return the likeliest of a few sizes of a walk [s^0.5]; 0 where none is clearly likelier than no walk.

    An offset of the clock and a wrong frequency are taken out of every run before. The noise beside the walk is that of
    what the likeliest walk under white noise leaves. Both together must be likelier than the plain noise, without any
    one run, too: lost frames are no walk.

    Args:
        walk: along the fit.
        left: residuals without anything that the saturated model explains.
        plain: noise of them without a walk.
        select: returns the noise of residuals, and a sentence on it.
    """
    levels = [left.flat(walk.levels(trial)[mask]) for trial, mask in zip(left.trials, left.masks, strict=True)]
    left = left.without(block_angular(np.zeros((sum(map(len, levels)), 0)), left.rows, levels))

    def over(base: Noise, size: float) -> ErrorsInVariables:
        return ErrorsInVariables.of(base, lambda trial: size * walk.modes(trial))

    first = max((over(Noise.white(left.scale), size) for size in _TRIED), key=left.log_likelihood)
    cleared = [first.cleared(*run) for run in zip(left.trials, left.masks, left.residuals, strict=True)]
    lost = left.lost + sum(degrees_of_freedom for _, degrees_of_freedom in cleared) / len(CHANNELS)
    base, _ = select(replace(left, residuals=[block for block, _ in cleared], lost=lost))
    size = max(_TRIED, key=lambda size: left.log_likelihood(over(base, size)))
    others = [[i for i in range(len(left.trials)) if i != run] for run in range(len(left.trials))]
    samples = [left, *(left.of_trials(some) for some in others if some)]
    gained = min(sample.log_likelihood(over(base, size)) - sample.log_likelihood(plain) for sample in samples)
    return size if gained >= CLEAR else 0.0


def with_size(problem: Problem, found: Fit, size: float) -> tuple[Problem, Fit]:
    """Return problem and fit with a walk of the likeliest size; without one where its size goes to nothing.

    Args:
        problem: without a walk.
        found: its fit.
        size: to begin with [s^0.5].
    """
    for _ in range(_ROUNDS):
        walking = replace(problem, walk=size)
        found = fit_or_raise(walking, walking.start(found.values), tolerance=1e-4)
        before, size = size, walk_size(walking, found)[0]
        if size < _NOTHING:
            return problem, fit_or_raise(problem, problem.start(found.values), tolerance=1e-4)
        if abs(size / before - 1.0) < _SAME:
            break
    return walking, found


def walk_size(problem: Problem, found: Fit, without: str = "") -> tuple[float, float]:
    """Return the next size of the walk [s^0.5], and how many modes the data determine.

    Args:
        problem, found: with a walk, and its fit.
        without: name of a run that does not take part.
    """
    modes = [(i, p.name.partition(f":{WALK}.")) for i, p in enumerate(found.parameters)]
    own = [i for i, (run, mode, _) in modes if mode and run != without]
    determined = float(np.sum(1.0 - np.diag(found.covariance)[own] / problem.walk**2))
    return float(np.sqrt(np.sum(found.x[own] ** 2) / max(determined, 1e-9))), determined


def of_every_run(problem: Problem, found: Fit) -> bool:
    """Return whether a walk is seen without any one run, too: frames that one run lost are no walk of the drive."""
    others = [walk_size(problem, found, trial.name)[0] for trial in problem.trials if len(problem.trials) > 1]
    return min(others, default=problem.walk) > _SHARE * problem.walk


def log_likelihood_gained(problem: Problem, found: Fit) -> float:
    """Return the marginal log-likelihood that a walk gains, its modes integrated out about their likeliest values.

        1/2 (SSE_0 - SSE) + 1/2 log det (C / size^2)

    with SSE of the fit, the prior of the modes in it, and SSE_0 without a walk.
    """
    own = [i for i, p in enumerate(found.parameters) if f":{WALK}." in p.name]
    _, log_determinant = np.linalg.slogdet(found.covariance[np.ix_(own, own)] / problem.walk**2)
    still = replace(problem, walk=0.0)
    return 0.5 * (
        fit_or_raise(still, still.start(found.values), tolerance=1e-4).sse - found.sse + float(log_determinant)
    )
