"""The noise behind the residual of a fit: the saturated residual, and what needs the model for it.

Process noise and errors of measured joint angles reach the velocities through the equation of motion, linearised along
the rollout: its state Jacobian A and its input Jacobian B,

    dv' = A(t) dv + a                                  process noise (`mjfish.noise.spectral`)
    dv' = A(t) dv + B(t) (dq, dq', dq''),  h = v_m - dv    errors in variables (`mjfish.noise.errors_in_variables`)

with (v_m, dq) a mode of the errors of velocities and joint angles that came out of one smoother
(`mjfish.data.trial`). Where the record does not come with its errors, v_m = 0, and every joint has white errors
of the size that its smoothing left over, smoothed as the angles were (`mjfish.drive.measured.smoothing`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import fft
from scipy.interpolate import BSpline, make_interp_spline

from mjfish.data import Trial
from mjfish.data.trial import Differentiator, Filter
from mjfish.drive.measured import Smoothing, smoothing
from mjfish.effects import Effect
from mjfish.estimation.fit import Fit
from mjfish.estimation.marginal_likelihood import first_size
from mjfish.estimation.omnibus import by_channel, functions
from mjfish.estimation.problem import Problem
from mjfish.files.plain_data import restored
from mjfish.fish import Cpg
from mjfish.fish.frames import CHANNELS
from mjfish.noise import (
    Autoregressive,
    DifferentiationNoise,
    ErrorsInVariables,
    GaussMarkov,
    Noise,
    NoiseByRate,
    NoiseSample,
    ProcessNoise,
    select,
)
from mjfish.noise.autoregressive import grid
from mjfish.noise.selection import CONTRADICTED, excess
from mjfish.noise.spectral import FILTERS
from mjfish.numerics.arrays import BoolArray, FloatArray, blocks_of, orthonormal, project_out, readonly
from mjfish.numerics.block_angular import BlockAngular, span
from mjfish.ode.jacobians import jacobians, linear_response

#: Cosines that stand for white errors of a joint, for every degree of freedom of its spline: faster ones do not pass.
_WAVES = 2.0
#: Longest trial whose white errors are allowed for: twelve thousand modes would take a minute and more.
_LONGEST = 1500
#: Errors whose share of the variance of the velocities' noise is below this one are left out.
_UNSEEN = 1e-2
#: What a filter must explain beyond the coefficients and all candidates: a p value of 1e-9 for one parameter more.
_CLEAR = 40.0


def noise_of(
    problem: Problem, fit: Fit, known: Sequence[FloatArray], stated: FloatArray | None, *, patterns: bool = True
) -> tuple[Noise, str]:
    """Return the noise model that the tests use, and a sentence on it where it is not the stated one.

    A record that comes with its errors keeps the stated noise beside them, while the data leave no more than that: an
    estimate of what is left beyond them would depend on which effects are tried (docs/notes/056).

    Args:
        problem: that was fitted.
        fit: its result.
        known: (n_r, 3, k) per trial, signatures of every effect that is not in the model.
        stated: (3,) sigma that the dataset gives, or None.
        patterns: whether to ask if a pattern of the runs is taken for noise.
    """
    left = saturated(problem, fit, known)
    jacobians = functools.cache(lambda: state_jacobians(problem, fit.values))
    joints = joint_errors(problem, fit)
    if joints is None:
        return select(left, stated, jacobians, patterns=patterns)
    recorded = stated if all(trial.errors is not None for trial in problem.trials) else None
    first = ErrorsInVariables.of(Noise.white(problem.noise.sigma if recorded is None else recorded), joints.loadings)
    cleared = [first.cleared(*arguments) for arguments in zip(left.trials, left.masks, left.residuals, strict=True)]
    left = replace(
        left,
        residuals=[block for block, _ in cleared],
        lost=left.lost + sum(degrees_of_freedom for _, degrees_of_freedom in cleared) / len(CHANNELS),
    )
    if recorded is not None and np.all(excess(left, recorded) < CONTRADICTED):
        return first, ""
    base, words = select(left, stated, jacobians, patterns=patterns)
    allowed = "errors of the measured joint angles are allowed for"
    return ErrorsInVariables.of(base, joints.loadings), f"{words}; {allowed}" if words else f"noise: {allowed}"


def walk_of(problem: Problem, fit: Fit, known: Sequence[FloatArray], noise: Noise) -> float:
    """Return the size of a walk of the drive's clock that the residual of a fit shows [s^0.5]; 0 where none is clear.

    Args:
        problem, fit, known: as in `noise_of`.
        noise: that this returned; where it is white, nothing wanders.
    """
    if isinstance(noise, Autoregressive) and noise.order == 0:
        return 0.0
    return first_size(problem, fit, saturated(problem, fit, known), noise)


def noise_sample(problem: Problem, residuals: Sequence[FloatArray]) -> NoiseSample:
    """Return residuals (n_r, 3) of the trials of a problem to estimate a noise from."""
    return NoiseSample.of(
        problem.trials, [problem.mask(i) for i in range(len(problem.trials))], residuals, problem.noise.sigma
    )


def saturated(problem: Problem, fit: Fit, known: Sequence[FloatArray]) -> NoiseSample:
    """Return residuals without anything that the saturated model explains; it weighs channels by sigma alone.

    Args:
        problem: that was fitted.
        fit: its result.
        known: (n_r, 3, k) per trial, signatures of every effect that is not in the model.
    """
    left, cpg = noise_sample(problem, problem.raw(fit.x)), problem.model.fish.cpg
    shapes = [functools.partial(_shapes, cpg, *pair) for pair in zip(problem.trials, left.masks, strict=True)]
    white = replace(problem, noise=Noise.white(problem.noise.sigma))
    return replace(left, shapes=shapes).without(
        white.velocity_rows(white.slopes(fit.x)).chosen(~fit.at_bound).beside(BlockAngular.of(white.whiten(known)))
    )


def _shapes(cpg: Cpg | None, trial: Trial, mask: BoolArray) -> FloatArray:
    """Return the omnibus waves (n_r, 3, columns) of the counted samples of a trial."""
    return by_channel(functions(cpg, trial, trial.time)[mask], range(len(CHANNELS)), len(CHANNELS))


def state_jacobians(problem: Problem, values: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return A (n, 3, 3) on the grid of the samples of every trial at some values of the parameters."""
    result = {}
    for i, trial in enumerate(problem.trials):
        run = problem.model.prepare(trial, values)
        rollout = problem.prediction(trial, values).rollout
        a, _ = jacobians(run.fish, rollout, values=run.coefficients, loads=run.loads, joints=False)
        times = float(trial.time[0]) + trial.step * np.arange(len(grid(trial.time, problem.mask(i))))
        result[trial.name] = readonly(a[np.clip(np.searchsorted(rollout.time, times), 0, len(a) - 1)])
    return result


@dataclass(frozen=True, eq=False)
class JointErrors:
    """How errors of measured joint angles reach the velocities.

    Attributes:
        problem: linearised.
        values: its parameters by name.
    """

    problem: Problem
    values: dict[str, float]
    _cache: dict[str, FloatArray] = field(default_factory=dict)

    def loadings(self, trial: Trial) -> FloatArray:
        """Return h (n, 3, modes) of a trial, all samples; of one that was not fitted, from its first velocity on."""
        if trial.name not in self._cache:
            first = {
                f"{trial.name}:start.{name}": float(v) for name, v in zip(CHANNELS, trial.first_velocity, strict=True)
            }
            self._cache[trial.name] = readonly(_loadings(self.problem, trial, {**first, **self.values}))
        return self._cache[trial.name]


def joint_errors(problem: Problem, fit: Fit) -> JointErrors | None:
    """Return how errors of joint angles reach the velocities of a fit; None where none were measured, or none show."""
    if not any(trial.joints_measured for trial in problem.trials):
        return None
    joints = JointErrors(problem, fit.values)
    energy = [np.square(joints.loadings(trial)).sum(axis=2).mean(axis=0) for trial in problem.trials]
    return joints if np.any(np.mean(energy, axis=0) > _UNSEEN * problem.noise.sigma**2) else None


def _loadings(problem: Problem, trial: Trial, values: dict[str, float]) -> FloatArray:
    read = np.zeros((len(trial.time), len(CHANNELS), 1))
    if trial.joint_angle is None or trial.commanded or (trial.errors is None and len(trial.time) > _LONGEST):
        return read
    run = problem.model.prepare(trial, values)
    rollout = problem.prediction(trial, values).rollout
    if rollout.message:  # nothing is linear about a run that diverges
        return read
    a, b = jacobians(run.fish, rollout, values=run.coefficients, loads=run.loads)
    time = rollout.time[: len(a)]
    joints = [smoothing(trial.time, trial.joint_angle[:, j]) for j in range(trial.joint_angle.shape[1])]
    if trial.errors is not None:
        read = trial.errors[:, :, :3].transpose(1, 2, 0)
        modes = [joint.of(trial.errors[:, :, 3 + j].T) for j, joint in enumerate(joints)]
        push = np.sum([_accelerations(b[..., j], time, mode) for j, mode in enumerate(modes)], axis=0)
    else:
        sigma = float(np.median([joint.sigma for joint in joints]))
        modes = [_white_errors(joint, sigma) for joint in joints]
        push = np.concatenate([_accelerations(b[..., j], time, mode) for j, mode in enumerate(modes)], axis=2)
    return np.asarray(read - make_interp_spline(time, linear_response(a, push, time), k=3)(trial.time))


def _accelerations(b: FloatArray, time: FloatArray, modes: BSpline) -> FloatArray:
    """Return the accelerations (n, 3, k) that modes of one joint cause, whose B is (n, 3, 3)."""
    return np.asarray(sum(b[:, :, order, None] * modes(time, nu=order)[:, None] for order in range(3)))


def _white_errors(joint: Smoothing, sigma: float) -> BSpline:
    """Return the modes of white errors of the angles of a joint, smoothed."""
    samples = joint.design.shape[0]
    count = min(samples, int(np.ceil(_WAVES * joint.degrees_of_freedom)))
    return joint.of(sigma * fft.idct(np.eye(samples)[:, :count], axis=0, norm="ortho"))


def smoothing_of(
    problem: Problem, fit: Fit, noise: Noise, others: Sequence[Effect], known: Sequence[FloatArray]
) -> Filter | None:
    """Return the filter that the motion of a recording went through; None where none is clear.

    Velocities that are not white in their noise were differentiated, smoothed, or both, and the motion with them. The
    noise may have come in later all the same; so each filter is tried on the prediction. It must explain what
    coefficients and candidates together do not, and more than any candidate alone would: what a strong cause has beyond
    first order looks like many things.

    Args:
        problem: that was fitted, with the leading cause where there is one.
        fit: its result.
        noise: that was found there.
        others: effects that may explain something and are not in the model.
        known: (n_r, 3, k) per trial, their signatures.
    """
    shortest = min(len(trial.time) for trial in problem.trials)
    if not (tried := [filter_ for filter_ in _filters(noise) if filter_.window < shortest]):
        return problem.smoothing
    weighed = replace(problem, noise=noise)
    predicted = replace(problem, smoothing=None).predictions(fit.x)
    columns = []
    for i, (trial, velocity) in enumerate(zip(problem.trials, predicted, strict=True)):
        smooth = [velocity, *(filter_.of_trial(trial, velocity) for filter_ in tried)]
        columns.append((trial.velocity[:, :, None] - np.stack(smooth, axis=2))[problem.mask(i)])
    coefficients = span(weighed.velocity_rows(problem.slopes(fit.x)))
    left, signs = (coefficients.off(weighed.whiten(blocks)) for blocks in (columns, known))
    alone = np.sum(left**2, axis=0)
    beside = np.sum(project_out(orthonormal(signs), left) ** 2, axis=0)
    best = 1 + int(np.argmin(beside[1:]))
    bases = [orthonormal(signs[:, block]) for block in blocks_of([len(effect.amplitudes()) for effect in others])]
    rival = max((float(np.sum((basis.T @ left[:, 0]) ** 2)) for basis in bases), default=0.0)
    return tried[best - 1] if beside[0] - beside[best] > _CLEAR and alone[0] - alone[best] > rival else None


def _filters(noise: Noise) -> list[Differentiator]:
    """Return the filters that the noise may have gone through."""
    pairs = FILTERS if isinstance(noise, Autoregressive) and noise.order else []
    if isinstance(noise, DifferentiationNoise):
        pairs = [(noise.window, noise.degree)]
    return [Differentiator(*pair, turned) for pair in pairs for turned in (False, True)]


_KINDS: dict[str, Callable[..., Noise]] = {
    kind.__name__: kind for kind in (Autoregressive, DifferentiationNoise, GaussMarkov, ProcessNoise)
}


def restore(saved: Mapping[str, Any], problem: Problem, values: Mapping[str, float]) -> Noise:
    """Return the noise model that `Noise.to_dict` saved.

    Args:
        saved: the plain data.
        problem: that the noise belongs to; its own noise does not matter.
        values: of its parameters: forces and errors of joint angles reach the velocities through the motion there.

    Raises:
        KeyError: an unknown kind, or a number is missing.
    """
    kind = saved["kind"]
    if kind == NoiseByRate.__name__:
        return NoiseByRate.of({float(step): restore(model, problem, values) for step, model in saved["models"].items()})
    if kind == ErrorsInVariables.__name__:
        return ErrorsInVariables.of(
            restore(saved["base"], problem, values), JointErrors(problem, dict(values)).loadings
        )
    found: Noise = restored(_KINDS[kind], saved)
    return replace(found, jacobians=state_jacobians(problem, values)) if isinstance(found, ProcessNoise) else found
