"""Errors of measured joint angles, as they reach the velocities: the fish that was simulated moved otherwise.

    y - y^ = e + sum_m a_m h_m,   a_m ~ N(0, 1),   h_m = v_m - dv_m,   dv' = A(t) dv + B(t) (dq_m, dq_m', dq_m'')

with (v_m, dq_m) a mode of the errors of velocities and joint angles that came out of one smoother
(`mjfish.data.error_modes`), and e what these leave out. Where the record does not come with its errors, e is the noise
of the velocities, v_m = 0, and every joint has white errors of the size that its smoothing left over, smoothed as the
angles were (`mjfish.drive.measured.smoothing`). With the h_m whitened as e is, H = Q S V', rows are made white by

    (I + H H')^(-1/2) = I + Q ((1 + S^2)^(-1/2) - 1) Q'
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import fft
from scipy.interpolate import BSpline, make_interp_spline

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.drive.measured import Smoothing, smoothing
from mjfish.estimation import Fit, Noise, Problem
from mjfish.frames import CHANNELS
from mjfish.noise.stepwise import Model, Stepwise
from mjfish.ode.jacobians import input_jacobian, linear_response, state_jacobian
from mjfish.serialise import unsaved

#: Cosines that stand for white errors of a joint, for every degree of freedom of its spline: faster ones do not pass.
_WAVES = 2.0
#: Longest trial whose white errors are allowed for: twelve thousand modes would take a minute and more.
_LONGEST = 1500
#: Errors whose share of the variance of the velocities' noise is below this one are left out.
_UNSEEN = 1e-2
#: Variance of the velocities' noise besides the modes of the errors, as a share of theirs.
_BESIDES = 0.1


@dataclass(frozen=True, eq=False)
class Misreading:
    """How errors of the joint angles reach the velocities.

    Attributes:
        problem: linearised.
        values: its parameters by name.
        made: by trial name, what was computed.
    """

    problem: Problem
    values: dict[str, float]
    made: dict[str, FloatArray] = field(default_factory=dict)

    def loadings(self, trial: Trial) -> FloatArray:
        """Return h (n, 3, modes) of a trial, all samples; of one that was not fitted, from its first velocity on."""
        if trial.name not in self.made:
            known = f"{trial.name}:start.surge" in self.values
            first = {f"{trial.name}:start.{name}": v for name, v in zip(CHANNELS, trial.velocity[0], strict=True)}
            values = self.values if known else {**self.values, **{k: float(v) for k, v in first.items()}}
            self.made[trial.name] = readonly(_loadings(self.problem, trial, values))
        return self.made[trial.name]


@dataclass(frozen=True, eq=False)
class Misread(Noise):
    """Noise of velocities whose joint angles have errors.

    Attributes:
        sigma, phi: of the noise of the velocities.
        base: that noise.
        through: how errors of the angles come on top.
    """

    base: Model | Stepwise = field(kw_only=True)
    through: Misreading = unsaved(kw_only=True)
    made: dict[tuple[str, bytes], tuple[FloatArray, ...]] = unsaved(default_factory=dict)

    @staticmethod
    def of(base: Model | Stepwise, through: Misreading) -> Misread:
        """Return noise `base` with errors of the angles on top."""
        return Misread(base.sigma, base.phi, base=base, through=through)

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Whiten columns (n, 3, ...) of a trial's counted samples."""
        white = self.base.of_trial(trial, mask, block, starts)
        basis, values, _ = self._span(trial, mask, starts)
        rows = white.reshape(len(basis), -1)
        shrink = 1.0 / np.sqrt(1.0 + values**2) - 1.0
        return np.asarray((rows + basis @ (shrink[:, None] * (basis.T @ rows))).reshape(white.shape))

    def cleared(
        self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]
    ) -> tuple[FloatArray, float]:
        """Return residuals (n, 3) less the likeliest errors of the angles, and the freedom that these took.

        The likeliest a are those of the largest posterior, a = (I + H'H)^-1 H' z.
        """
        basis, values, turn = self._span(trial, mask, starts)
        white = self.base.of_trial(trial, mask, block, starts).ravel()
        shrink = 1.0 / (1.0 + values**2)
        likeliest = turn.T @ (values * shrink * (basis.T @ white))
        return np.asarray(block - self.through.loadings(trial)[mask] @ likeliest), float(np.sum(1.0 - shrink))

    def _span(self, trial: Trial, mask: BoolArray, starts: Sequence[int]) -> tuple[FloatArray, ...]:
        """Return Q (rows, k), S (k,) and V' (k, modes) of the whitened loadings."""
        key = (trial.name, mask.tobytes())
        if key not in self.made:
            white = self.base.of_trial(trial, mask, self.through.loadings(trial)[mask], starts)
            self.made[key] = tuple(np.linalg.svd(white.reshape(-1, white.shape[-1]), full_matrices=False))
        return self.made[key]


def misreading(problem: Problem, fit: Fit) -> Misreading | None:
    """Return how errors of joint angles reach the velocities of a fit; None where none were measured, or none show."""
    if all(trial.joint_angle is None for trial in problem.trials):
        return None
    through = Misreading(problem, fit.values)
    energy = [np.square(through.loadings(trial)).sum(axis=2).mean(axis=0) for trial in problem.trials]
    return through if np.any(np.mean(energy, axis=0) > _UNSEEN * problem.noise.sigma**2) else None


def unaccounted(trials: Sequence[Trial]) -> FloatArray | None:
    """Return sigma (3,) of what the modes of the errors leave out of the velocities; None where a trial has no modes.

    They are linear, and of the noise that the smoother saw: a tenth of their variance is allowed for on top.
    """
    variances = [np.square(trial.errors[:, :, :3]).sum(axis=0) for trial in trials if trial.errors is not None]
    if len(variances) < len(trials):
        return None
    return np.asarray(np.sqrt(_BESIDES * np.concatenate(variances).mean(axis=0)))


def _loadings(problem: Problem, trial: Trial, values: dict[str, float]) -> FloatArray:
    read = np.zeros((len(trial.time), len(CHANNELS), 1))
    if trial.joint_angle is None or (trial.errors is None and len(trial.time) > _LONGEST):
        return read
    run = problem.model.prepare(trial, values)
    rollout = problem.prediction(trial, values).rollout
    if rollout.message:  # nothing is linear about a run that diverges
        return read
    a, b = (of(run.fish, rollout, values=run.coefficients, loads=run.loads) for of in (state_jacobian, input_jacobian))
    time = rollout.time[: len(a)]
    joints = [smoothing(trial.time, trial.joint_angle[:, j]) for j in range(trial.joint_angle.shape[1])]
    if trial.errors is not None:
        read = trial.errors[:, :, :3].transpose(1, 2, 0)
        modes = [one.of(trial.errors[:, :, 3 + j].T) for j, one in enumerate(joints)]
        push = np.sum([_push(b[..., j], time, mode) for j, mode in enumerate(modes)], axis=0)
    else:
        sigma = float(np.median([one.sigma for one in joints]))
        push = np.concatenate([_push(b[..., j], time, _white(one, sigma)) for j, one in enumerate(joints)], axis=2)
    moved = make_interp_spline(time, linear_response(a, push, time), k=3)
    return np.asarray(read - moved(trial.time))


def _push(steered_: FloatArray, time: FloatArray, modes: BSpline) -> FloatArray:
    """Return the accelerations (n, 3, k) that modes of one joint cause, whose B is (n, 3, 3)."""
    return np.asarray(sum(steered_[:, :, order, None] * modes(time, nu=order)[:, None] for order in range(3)))


def _white(joint: Smoothing, sigma: float) -> BSpline:
    """Return the modes of white errors of the angles of a joint, smoothed."""
    samples = joint.design.shape[0]
    count = min(samples, int(np.ceil(_WAVES * joint.freedom)))
    return joint.of(sigma * fft.idct(np.eye(samples)[:, :count], axis=0, norm="ortho"))
