"""The least-squares problem: free parameters in, whitened residuals and their derivatives out."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, blocks_of
from mjfish.data import Trial
from mjfish.data.filters import Filter
from mjfish.effects.effect import Effect
from mjfish.estimation import clocks
from mjfish.frames import CHANNELS, UNITS
from mjfish.model import MARGIN, Model, Prediction
from mjfish.model.sensitivity import one_sided, sensitivities
from mjfish.noise import Noise
from mjfish.parameter import Parameter
from mjfish.prior import Prior
from mjfish.serialise import plain
from mjfish.threads import threaded

#: Residual of a sample that the rollout did not reach, in units of sigma: worse than any honest misfit.
LOST = 1e3
#: Scale and half-range of start velocities around the measured ones [m/s, m/s, rad/s], and of clock offsets [s].
_START_SCALE = (0.01, 0.01, 0.05)
_START_RANGE = (0.1, 0.1, 0.5)
_CLOCK_SCALE = 0.005


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals of a model on trials, as a function of its free parameters.

    Attributes:
        model: the model.
        trials: all fitted together.
        noise: gives the weights.
        fixed: parameters that are not free, with their values; all others are, those of single trials too.
        declared: other declarations (bounds, starts, priors) for parameters, by name; the scale of waves is a parameter
            where it is declared here.
        free_clock: whether each trial has a clock offset of its own.
        windows: per trial, the times [s] between which samples count; None: all of it.
        ends: how many samples at either end of every trial do not count.
        slope_step: longest integration step of the derivatives [s]; None: that of the model. A fit goes by them, where
            it ends the residuals say: they may be rougher.
        smoothing: filter that the recorded velocities went through, and predictions do, too; None: none.
        nominal: names of the effects that are a part of the nominal model; others are causes that extend it.
        prior_sds: of learned priors, by name; those of others, and where it has none, are the declared ones.
        jobs: threads.
    """

    model: Model
    trials: tuple[Trial, ...]
    noise: Noise
    fixed: Mapping[str, float] = field(default_factory=dict)
    declared: Mapping[str, Parameter] = field(default_factory=dict)
    free_clock: bool = False
    windows: tuple[tuple[float, float] | None, ...] | None = None
    ends: int = 0
    slope_step: float | None = None
    smoothing: Filter | None = None
    nominal: tuple[str, ...] = ()
    prior_sds: Mapping[str, float] = field(default_factory=dict)
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The free parameters: the model's, then the nuisance parameters of every trial."""
        own = (p for trial in self.trials for p in nuisances(trial, self.free_clock))
        scales = [clocks.SCALE, *(f"{trial.name}:{clocks.SCALE}" for trial in self.trials)]
        scaled = (clocks.scale(name) for name in scales if name in self.declared)
        every = (*self.model.parameters, *own, *scaled)
        return tuple(self.declared.get(p.name, p) for p in every if p.name not in self.fixed)

    @property
    def causes(self) -> tuple[Effect, ...]:
        """The effects that extend the nominal model."""
        return tuple(effect for effect in self.model.effects if effect.name not in self.nominal)

    @cached_property
    def known(self) -> tuple[int, ...]:
        """Places of the free parameters of which more than bounds is known.

        Each is a row of data more, behind those of the trials: its `deviation`, which has mean 0 and variance 1.
        """
        return tuple(i for i, p in enumerate(self.parameters) if p.sd is not None)

    def known_rows(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (k,) of the known parameters, expected less found in units of their sds; derivatives (k, p).

        The derivatives are of what was found, as those of a prediction.
        """
        rates = np.zeros((len(self.known), len(x)))
        for row, i in enumerate(self.known):
            rates[row, i] = self.parameters[i].deviation_rate(float(x[i]))
        return np.array([-self.parameters[i].deviation(float(x[i])) for i in self.known]), rates

    @cached_property
    def samples(self) -> int:
        """Number of rows that were measured: those in front of the known parameters'."""
        return sum(len(CHANNELS) * int(np.count_nonzero(self.mask(i))) for i in range(len(self.trials)))

    @cached_property
    def priors(self) -> tuple[Prior, ...]:
        """Priors of the effects: what keeps learned curves smooth."""
        declared = (prior for effect in self.model.effects for prior in effect.priors())
        return tuple(replace(prior, sd=self.prior_sds.get(prior.name, prior.sd)) for prior in declared)

    def prior_rows(self, prior: Prior) -> FloatArray:
        """Return the rows (m, p) of a prior over the free parameters, in units of its sd."""
        places = {p.name: i for i, p in enumerate(self.parameters)}
        rows = np.zeros((len(prior.rows), len(places)))
        for name, column in zip(prior.parameters, prior.rows.T, strict=True):
            if name in places:
                rows[:, places[name]] = column / prior.sd
        return rows

    @cached_property
    def prior_root(self) -> FloatArray:
        """Rows R (m, p) of all priors: they add |R x - `prior_mean`|^2 to the sum of squares."""
        return np.concatenate([np.zeros((0, len(self.parameters))), *map(self.prior_rows, self.priors)])

    @cached_property
    def prior_mean(self) -> FloatArray:
        """Means (m,) of the rows of all priors, in units of their sds."""
        return np.concatenate([np.zeros(0), *(np.full(len(p.rows), p.mean / p.sd) for p in self.priors)])

    def to_dict(self) -> dict[str, Any]:
        """Return how data and model are compared as plain data; model and trials are told elsewhere."""
        fields = {"noise": self.noise, "ends": self.ends, "slope_step": self.slope_step, "smoothing": self.smoothing}
        return {key: plain(value) for key, value in fields.items()}

    def residual(self, x: FloatArray) -> FloatArray:
        """Return whitened residuals (measured - predicted), all trials and channels stacked; then `known_rows`."""
        measured = self._stack(self._run([(trial, self.named(x)) for trial in self.trials]))
        return np.concatenate([measured, self.known_rows(x)[0]]) if self.known else measured

    def raw(self, x: FloatArray) -> list[FloatArray]:
        """Return residuals (n_r, 3) of every trial's counted samples, in physical units."""
        predicted = self._run([(trial, self.named(x)) for trial in self.trials])
        return [
            (trial.velocity - velocity)[self.mask(i)]
            for i, (trial, velocity) in enumerate(zip(self.trials, predicted, strict=True))
        ]

    def predictions(self, x: FloatArray) -> list[FloatArray]:
        """Return predicted velocities (n_r, 3) of every trial, all samples."""
        return self._run([(trial, self.named(x)) for trial in self.trials])

    def divergence(self, x: FloatArray) -> str:
        """Return which trial diverges, when and with which parameters; empty where none does."""
        predicted = [(trial, self.prediction(trial, self.named(x))) for trial in self.trials]
        lost = [(trial, rollout) for trial, rollout in predicted if not np.all(np.isfinite(rollout.velocity))]
        return "; ".join(f"{trial.name} {rollout.message}" for trial, rollout in lost)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the derivative (n, p) of the whitened *prediction* by the free parameters; then `known_rows`."""
        rows = self.whiten(self.sensitivities(x))
        if self.known:
            rows[self.samples :] = self.known_rows(x)[1]
        return rows

    def whiten(self, blocks: Sequence[FloatArray]) -> FloatArray:
        """Whiten blocks (n_r, 3, k), one a trial, and stack them to (n, k): zeros in the rows of known parameters."""
        if blocks[0].shape[2] == 0:  # filters refuse columns that are none
            return self.whiten([np.zeros((len(block), len(CHANNELS), 1)) for block in blocks])[:, :0]
        whitened = [self.whitened(i, block).reshape(-1, block.shape[2]) for i, block in enumerate(blocks)]
        return self.padded(np.concatenate(whitened))

    def padded(self, rows: FloatArray) -> FloatArray:
        """Return columns (n, k) of what was measured with zeros in the rows of known parameters."""
        return np.concatenate([rows, np.zeros((len(self.known), rows.shape[1]))]) if self.known else rows

    def whitened(self, index: int, block: FloatArray) -> FloatArray:
        """Whiten columns (n_r, 3, ...) of the counted samples of one trial."""
        return self.noise.whiten(self.trials[index], self.mask(index), block)

    def sensitivities(self, x: FloatArray, only: Sequence[str] | None = None) -> list[FloatArray]:
        """Return, per trial, the derivative (n_r, 3, k) of the prediction by the free parameters or those in `only`.

        Exact (`mjfish.model.sensitivity`); at a bound where the model changes its form, such as a servo without lag, a
        one-sided difference of second order over a tenth of the parameter's scale.
        """
        parameters = self.parameters
        chosen = [parameters[i] for i in range(len(parameters)) if only is None or parameters[i].name in only]
        here = self.named(x)
        slopes = self._map(lambda trial: self._slopes(trial, here, chosen), self.trials)
        return [np.nan_to_num(slope)[self.mask(i)] for i, slope in enumerate(slopes)]

    def _slopes(self, trial: Trial, here: Mapping[str, float], chosen: Sequence[Parameter]) -> FloatArray:
        """Return the derivative (n_r, 3, k) of one trial's prediction by the chosen parameters."""
        result = np.zeros((len(trial.time), len(CHANNELS), len(chosen)))
        own = {k: p.name.removeprefix(f"{trial.name}:") for k, p in enumerate(chosen) if not elsewhere(p, trial)}
        model = self._sloping
        rough = [k for k, name in own.items() if one_sided(model, name, here[chosen[k].name])]
        exact = [k for k in own if k not in rough]
        velocity, offset = self._start(trial, here)
        slopes = sensitivities(
            model, clocks.clocked(trial, here), here, [own[k] for k in exact], velocity=velocity, offset=offset
        )
        for column, k in enumerate(exact):
            if own[k] == clocks.SCALE:  # derived relative to the scale that the wave has
                slopes[:, :, column] /= here[chosen[k].name]
        result[:, :, exact] = self._smoothed(trial, slopes)
        if rough:
            base = self._predict((trial, dict(here)))
        for k in rough:
            name, h = chosen[k].name, 0.1 * chosen[k].scale
            near, far = (self._predict((trial, {**here, name: here[name] + by})) for by in (h, 2.0 * h))
            result[:, :, k] = (2.0 * near - 1.5 * base - 0.5 * far) / h
        return result

    @cached_property
    def _sloping(self) -> Model:
        """The model that is derived."""
        return self.model if self.slope_step is None else replace(self.model, step=self.slope_step)

    @property
    def rough(self) -> Problem:
        """The same by the step of the derivatives throughout: for residuals that are compared with one another only."""
        return replace(self, model=self._sloping)

    def mask(self, index: int) -> BoolArray:
        """Return which samples (n_r,) of a trial count.

        Left out are the samples next to a step of the drive, where the velocity jumps and a reading depends on which
        side of the step it fell; `ends`; where the joints were measured, the ends: a shifted clock would ask for motion
        that nobody saw; and where velocities were smoothed, what the filter feels of such a step or of an end.
        """
        trial = self.trials[index]
        keep = np.ones(len(trial.time), dtype=np.bool_)
        beside = 1.5 * trial.step
        if self.smoothing is not None:
            reach = self.smoothing.reach(trial.step)
            beside += reach
            keep &= (trial.time >= trial.time[0] + reach) & (trial.time <= trial.time[-1] - reach)
        cut = (self.ends - 0.5) * trial.step
        keep &= (trial.time >= trial.time[0] + cut) & (trial.time <= trial.time[-1] - cut)
        for segment in trial.drive[1:]:
            keep &= np.abs(trial.time - segment.start) > beside
        if trial.joint_angle is not None:
            keep &= (trial.time >= trial.time[0] + MARGIN) & (trial.time <= trial.time[-1] - MARGIN)
        window = self.windows[index] if self.windows is not None else None
        if window is not None:
            keep &= (trial.time >= window[0]) & (trial.time <= window[1])
        return keep

    def rows_by_trial(self) -> list[slice]:
        """Return where the rows of each trial stand in a whitened residual."""
        counted = (int(np.count_nonzero(self.mask(i))) for i in range(len(self.trials)))
        return blocks_of([len(CHANNELS) * samples for samples in counted])

    def start(self, given: Mapping[str, float] | None = None) -> FloatArray:
        """Return the start vector: `given` by name where it has one, else each parameter's declared start."""
        return np.array([(given or {}).get(p.name, p.start) for p in self.parameters])

    def named(self, x: FloatArray) -> dict[str, float]:
        """Return free and fixed parameters by name."""
        return {**self.fixed, **{p.name: float(v) for p, v in zip(self.parameters, x, strict=True)}}

    def _stack(self, predicted: list[FloatArray]) -> FloatArray:
        parts = []
        for i, (trial, velocity) in enumerate(zip(self.trials, predicted, strict=True)):
            keep = self.mask(i)
            if np.all(np.isfinite(velocity)):
                parts.append(self.whitened(i, (trial.velocity - velocity)[keep]).ravel())
            else:
                parts.append(np.full(len(CHANNELS) * int(np.count_nonzero(keep)), LOST))
        return np.concatenate(parts)

    def _run(self, tasks: list[tuple[Trial, dict[str, float]]]) -> list[FloatArray]:
        return self._map(self._predict, tasks)

    def _map(self, function: Callable[[Any], FloatArray], tasks: Sequence[Any]) -> list[FloatArray]:
        return list(threaded(function, tasks, self.jobs))

    def _predict(self, task: tuple[Trial, dict[str, float]]) -> FloatArray:
        return self._smoothed(task[0], self.prediction(*task).velocity)

    def _smoothed(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Return predicted columns (n_r, 3, ...) as the recording of the trial would have them."""
        if self.smoothing is None or block.size == 0 or not np.all(np.isfinite(block)):
            return block
        return self.smoothing.of_trial(trial, block)

    def prediction(self, trial: Trial, values: Mapping[str, float]) -> Prediction:
        """Predict one trial, its start velocity and clock from `values` where they are free."""
        velocity, offset = self._start(trial, values)
        return self.model.predict(clocks.clocked(trial, values), values, velocity=velocity, offset=offset)

    @staticmethod
    def _start(trial: Trial, values: Mapping[str, float]) -> tuple[FloatArray | None, float]:
        """Return velocity (3,) at the start, None at rest, and the clock offset [s] of a trial."""
        velocity = None
        if not trial.starts_at_rest:
            velocity = np.array([values[f"{trial.name}:start.{channel}"] for channel in CHANNELS])
        return velocity, values.get(f"{trial.name}:clock.offset", 0.0)


def nuisances(trial: Trial, free_clock: bool) -> tuple[Parameter, ...]:
    """Return what must be fitted in this trial alone.

    Start velocity unless at rest, clock offset where it is free, frequency and phase of a wave with a clock of its own.
    """
    declared = []
    if not trial.starts_at_rest:
        for channel, scale, reach, measured in zip(
            CHANNELS, _START_SCALE, _START_RANGE, trial.velocity[0], strict=True
        ):
            centre = float(measured)
            declared.append(
                Parameter(
                    f"{trial.name}:start.{channel}",
                    UNITS[channel],
                    centre,
                    centre - reach,
                    centre + reach,
                    centre,
                    scale,
                    about="velocity at the start",
                )
            )
    if free_clock:
        declared.append(
            Parameter(f"{trial.name}:clock.offset", "s", 0.0, -0.25, 0.25, 0.0, _CLOCK_SCALE, about="clock offset")
        )
    return (*declared, *clocks.parameters(trial))


def elsewhere(parameter: Parameter, trial: Trial) -> bool:
    """Return whether the parameter is a nuisance of another trial."""
    owner, separator, _ = parameter.name.rpartition(":")
    return bool(separator) and owner != trial.name
