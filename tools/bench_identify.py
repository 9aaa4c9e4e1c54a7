"""Comparisons of `tools/bench.py` about whole fits: nine coefficients free, from the start values of Table III.

Both sides get the same synthetic trials, noise, bounds and start, one thread, and the same optimiser with the same
tolerances, scipy's trf; they must end at the same cost. What differs is the simulation and where its slopes come from.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray
from scipy import optimize

import prescribed
from comparison import Comparison, Side
from mjfish.data import Trial
from mjfish.drive import cpg, modes
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import frames, load_fish
from mjfish.model import Model
from mjfish.mujoco import StripFluid, mjcf
from mjfish.simulation.synthetic import generate
from plain_model import PlainModel

FloatArray = NDArray[np.float64]
TimeSeries = sysid.TimeSeries

_PIKE = load_fish("pike")
_SIGMA = np.array([0.01, 0.01, 0.05])
#: Inside the bounds of Table III, away from its start values: c_m, c_d, c_f of head, body, tail.
_TRUTH = dict(zip(_PIKE.coefficient_names, (0.5, 0.6, 0.4, 1.5, 1.2, 1.6, 0.01, 0.008, 0.012), strict=True))
_RATE = 50.0
_TOLERANCES = {"x_scale": "jac", "ftol": 1e-8, "xtol": 1e-8, "gtol": 1e-8}
#: Costs may differ by this share.
_SAME = 1e-3
#: Step of MuJoCo, RK4 [s]: the longest in whole milliseconds with which the costs agree, for `mujoco.sysid` holds the
#: controls during a step.
_HELD = 0.002
#: Relative tolerance of `solve_ivp`: the loosest power of ten with which the costs agree.
_RTOL = 1e-5


def posed(names: Sequence[str], duration: float) -> Problem:
    """Return the fit of synthetic trials, one a mode."""
    synthetic = generate(_PIKE, names, values=_TRUTH, noise=_SIGMA, rate=_RATE, duration=duration, seed=1)
    return Problem(Model(_PIKE), synthetic.trials, Noise.white(_SIGMA))


def fit_vs_mujoco_sysid() -> Comparison:
    """Two modes of 10.4 s: the fit, against mujoco.sysid with the MuJoCo fish, its joints moving as they are told.

    Only modes without a change: no control makes the rate of a joint jump. The ratio is one of simulations and slopes,
    for the optimiser is the same. sysid's own, its default, takes twice the rollouts of trf here, but half where
    the optimum rests on bounds; and a hand-written rollout that feeds every stage of RK4, as sysid's does not, could
    take steps of 5 ms. Either halves the ratio.
    """
    problem = posed(("v1", "v7"), modes.DURATION)
    return _fits(
        "fit_vs_mujoco_sysid", Side("mujoco.sysid, RK4, step 2 ms", SysidFit(problem), warm=False), problem, 10
    )


def fit_vs_solve_ivp() -> Comparison:
    """Two modes of 2 s: the fit, against 2-point differences of plain NumPy in solve_ivp."""
    problem = posed(("v1", "v5"), 2.0)
    top = Side("2-point differences of solve_ivp, plain NumPy", PlainFit(problem), warm=False)
    return _fits("fit_vs_solve_ivp", top, problem, 100)


def _fits(name: str, top: Side, problem: Problem, target: float) -> Comparison:
    def agree(other: float, ours: float) -> None:
        if not abs(other - ours) < _SAME * ours:
            raise SystemExit(f"{name}: the fits do not end at the same cost: {other:.6g} and {ours:.6g}")

    return Comparison(
        top=top,
        bottom=Side("mjfish.estimation.fit, step 5 ms", lambda: fit(problem).cost, times=3),
        target=target,
        at_least=True,
        repeats=1,
        agree=agree,
    )


class PlainFit:
    """The fit as one would write it with NumPy and scipy alone; returns the cost."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def __call__(self) -> float:
        """Fit."""
        declared = self.problem.parameters
        bounds = ([p.low for p in declared], [p.high for p in declared])
        found = optimize.least_squares(self.residual, self.problem.start(), bounds=bounds, **_TOLERANCES)
        return 2.0 * float(found.cost)

    def residual(self, x: FloatArray) -> FloatArray:
        """Return the residual, by sigma."""
        fish = _PIKE.with_values(dict(zip(_PIKE.coefficient_names, x, strict=True)))
        found = [
            (PlainModel(fish, trial.drive[0].omega).velocity(trial.time, rtol=_RTOL) - trial.velocity) / _SIGMA
            for trial in self.problem.trials
        ]
        return np.concatenate(found).ravel()


class SysidFit:
    """The fit by mujoco.sysid; returns the cost. A candidate's model is compiled and put into water of its own."""

    def __init__(self, problem: Problem) -> None:
        self.start = [sysid.Parameter(p.name, p.start, p.low, p.high) for p in problem.parameters]
        spec = prescribed.specification(_PIKE, "RK4", _HELD)
        for channel, joint in zip(frames.CHANNELS, ("x", "y", "yaw"), strict=True):  # sysid asks for as many as data
            kind = mujoco.mjtSensor.mjSENS_JOINTVEL
            spec.add_sensor(name=channel, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
        self.water = self._water(spec, _TRUTH)
        fed = [self._feed(trial) for trial in problem.trials]
        measured = sysid.ModelSequences(
            "pike",
            spec,
            [trial.name for trial in problem.trials],
            [start for start, _ in fed],
            [control for _, control in fed],
            [TimeSeries.from_names(trial.time, trial.velocity, self.water.model) for trial in problem.trials],
        )
        self.residual = sysid.build_residual_fn(
            models_sequences=[measured],
            build_model=self._build,
            modify_residual=_whitened,
            n_threads=1,
            resample_true=False,
        )

    def __call__(self) -> float:
        """Fit."""
        parameters = sysid.ParameterDict()
        for one in self.start:
            parameters.add(one)
        parameters.reset()  # a fit before this one has changed them
        with self.water.installed(), contextlib.redirect_stdout(io.StringIO()):
            _, found = sysid.optimize(
                parameters, self.residual, optimizer="scipy_parallel_fd", verbose=False, **_TOLERANCES
            )
        return 2.0 * float(found.cost)

    def _build(self, parameters: sysid.ParameterDict, spec: mujoco.MjSpec) -> mujoco.MjModel:
        return self._water(spec, dict(zip(_PIKE.coefficient_names, parameters.as_vector().tolist(), strict=True))).model

    @staticmethod
    def _water(spec: mujoco.MjSpec, values: dict[str, float]) -> StripFluid:
        return StripFluid(spec.compile(), mjcf.strips(_PIKE, values), density=_PIKE.density)

    def _feed(self, trial: Trial) -> tuple[FloatArray, TimeSeries]:
        """Return the initial state and, for each step, the mean acceleration of the joints: their rates are exact."""
        time = _HELD * np.arange(round(trial.time[-1] / _HELD) + 1)
        motion = cpg.joint_motion(_PIKE.cpg, trial.drive, float(time[-1]), _HELD)
        boundaries = np.searchsorted(motion.time, time - 0.01 * _HELD)
        rate = np.concatenate([motion.rate[:, 0], motion.rate[-1:, 2]])[boundaries]
        held = np.append(np.diff(rate, axis=0) / _HELD, np.zeros_like(rate[:1]), axis=0)
        root = np.zeros(mjcf.ROOT)
        start = sysid.create_initial_state(
            self.water.model, np.append(root, motion.angle[0, 0]), np.append(root, rate[0])
        )
        return start, TimeSeries(time, held)


def _whitened(
    _parameters: object,
    _predicted: TimeSeries,
    measured: TimeSeries,
    model: mujoco.MjModel,
    _everything: bool,
    *,
    state: FloatArray,
    **_: object,
) -> tuple[FloatArray, TimeSeries, TimeSeries]:
    """Return the residual of the nose's velocity in its own frame, by sigma; sysid's own divides by the signal."""
    every = round(1.0 / (_RATE * _HELD))
    sampled = state[every - 1 :: every]  # begins behind the first step
    speed, yaw = sampled[:, 1 + model.nq :], sampled[:, mjcf.ROOT]
    velocity = np.column_stack([frames.to_body(speed[:, :2], yaw), speed[:, 2]])
    at_rest = np.zeros((1, len(frames.CHANNELS)))
    return (np.concatenate([at_rest, velocity]) - measured.data) / _SIGMA, measured, measured


COMPARISONS: tuple[Callable[[], Comparison], ...] = (fit_vs_mujoco_sysid, fit_vs_solve_ivp)
