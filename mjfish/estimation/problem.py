"""The least-squares problem: free parameters in, whitened residuals and their derivatives out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mjfish.data import Sensor, Trial, columns
from mjfish.data.columns import POSE
from mjfish.data.trial import Filter
from mjfish.effects.effect import Effect
from mjfish.estimation import clocks
from mjfish.execution import check_time, mapped
from mjfish.files.plain_data import plain
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.model import MARGIN, Model, Prediction
from mjfish.model.sensitivity import one_sided, with_sensors
from mjfish.noise import Noise
from mjfish.numerics.arrays import BoolArray, FloatArray, blocks_of
from mjfish.numerics.block_angular import BlockAngular, IntArray, Part
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior

if TYPE_CHECKING:
    from mjfish.estimation.sensor_noise import Whitening

#: Residual of a sample that the rollout did not reach, in units of sigma: worse than any honest misfit.
LOST = 1e3
#: Scale and half-range of start velocities [m/s, m/s, rad/s], the standard deviation of measured ones, and scale and
#: half-range of clock offsets [s].
_START_SCALE = (0.01, 0.01, 0.05)
_START_RANGE = (2.0, 1.0, 10.0)
_START_SD = (0.1, 0.1, 0.5)
_CLOCK_SCALE, _CLOCK_RANGE = 0.005, 0.25
#: Scale and half-range of the pose at the start around a first guess of it [m, m, rad].
_POSE_SCALE = (0.01, 0.01, 0.02)
_POSE_RANGE = (5.0, 5.0, 4.0)
#: Share of a track that gives a first guess of the heading.
_FIRST_PART = 0.2


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of a prediction by some parameters; a trial has columns of those that it depends on.

    Attributes:
        shared: (s,) places of the columns that all trials have.
        per_trial: (k_r,) a trial, places of those that it alone has.
        velocity: (n_r, 3, s + k_r) a trial, of its counted samples, in physical units: shared columns, then its own.
        sensors: (m, s + k_r) rows of each sensor of each trial, whitened.
        lost: parameters whose derivatives are not finite somewhere; they are 0 there. By name, with the first place.
    """

    shared: IntArray
    per_trial: list[IntArray]
    velocity: list[FloatArray]
    sensors: list[FloatArray]
    lost: Mapping[str, str] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Bytes of the derivatives."""
        return sum(block.nbytes for block in (*self.velocity, *self.sensors))

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self.shared) + sum(map(len, self.per_trial))


@dataclass(frozen=True)
class _Predicted:
    """Velocities (n, 3) of one trial as its recording has them, and what its sensors read."""

    velocity: FloatArray
    sensors: tuple[FloatArray, ...]

    @property
    def blocks(self) -> tuple[FloatArray, ...]:
        """Both."""
        return self.velocity, *self.sensors

    @property
    def lost(self) -> bool:
        """Whether the rollout did not reach every sample."""
        return not all(np.all(np.isfinite(block)) for block in self.blocks)

    def lost_in(self, trial: Trial) -> str:
        """Return the first number that is not finite: its channel, trial and time [s]; empty where there is none."""
        read = ((s.channels, s.time, block) for s, block in zip(trial.sensors, self.sensors, strict=True))
        for channels, time, block in ((CHANNELS, trial.time, self.velocity), *read):
            for row, channel in np.argwhere(~np.isfinite(block))[:1]:
                return f"{channels[channel]} of trial {trial.name} at {time[row]:.4g} s"
        return ""


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
        ends: how many velocities at either end of every trial do not count.
        slope_step: longest integration step of the derivatives [s]; None: that of the model. A fit goes by them, where
            it ends the residuals say: they may be rougher.
        smoothing: filter that the recorded velocities went through, and predictions do, too; None: none.
        nominal: names of the effects that are a part of the nominal model; others are causes that extend it.
        prior_sds: of learned priors, by name; those of others, and where it has none, are the declared ones.
        sensor_sigma: (c,) of every sensor whose sigma is not stated, by name.
        joint_errors: returns what whitens the sensors of a trial for the errors of its measured joint angles, of the
            sigma and the mask of each; None where they do not matter: its sensors have white noise alone then, and
            those of all trials where it is None.
        walk: size of the walk of the drive's clock [s^0.5], whose modes are parameters of every trial; 0: none.
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
    sensor_sigma: Mapping[str, FloatArray] = field(default_factory=dict)
    joint_errors: Callable[[Trial, Sequence[FloatArray], Sequence[BoolArray]], Whitening | None] | None = None
    walk: float = 0.0

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The free parameters: the model's, then the nuisance parameters of every trial."""
        own = (p for trial in self.trials for p in nuisances(trial, self.free_clock, self.walk))
        scales = (clocks.SCALE, *(f"{trial.name}:{clocks.SCALE}" for trial in self.trials))
        every = (*self.model.parameters, *own, *(clocks.scale(name) for name in scales if name in self.declared))
        return tuple(self.declared.get(p.name, p) for p in every if p.name not in self.fixed)

    @property
    def causes(self) -> tuple[Effect, ...]:
        """The effects that extend the nominal model."""
        return tuple(effect for effect in self.model.effects if effect.name not in self.nominal)

    @cached_property
    def with_priors(self) -> tuple[int, ...]:
        """Places of the free parameters of which more than bounds is known.

        Each is a row of data more, behind those of velocities and sensors: its `deviation`, of mean 0 and variance 1.
        """
        return tuple(i for i, p in enumerate(self.parameters) if p.sd is not None)

    def deviation_rows(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (k,) of the known parameters, expected less found in units of their sds; derivatives (k, p).

        The derivatives are of what was found, as those of a prediction.
        """
        rates, places = np.zeros((len(self.with_priors), len(x))), list(self.with_priors)
        rates[range(len(places)), places] = [*self.deviation_rates(x).values()]
        return np.array([-self.parameters[i].deviation(float(x[i])) for i in places]), rates

    def deviation_rates(self, x: FloatArray) -> dict[str, float]:
        """Return the rate of each known parameter's `deviation` by its value, by name."""
        return {self.parameters[i].name: self.parameters[i].deviation_rate(float(x[i])) for i in self.with_priors}

    @cached_property
    def samples(self) -> int:
        """Number of rows of velocities, three a sample: those in front of the sensors'."""
        return sum(len(CHANNELS) * int(np.count_nonzero(self.mask(i))) for i in range(len(self.trials)))

    @cached_property
    def measured(self) -> int:
        """Number of rows of velocities and sensors: those in front of the known parameters'."""
        return self.sensor_rows[-1].stop if self.sensor_rows else self.samples

    @cached_property
    def sensors(self) -> tuple[tuple[int, Sensor], ...]:
        """Every sensor with the place of its trial, in the order of their rows."""
        return tuple((i, sensor) for i, trial in enumerate(self.trials) for sensor in trial.sensors)

    @cached_property
    def sensor_rows(self) -> list[slice]:
        """Where the rows of each of `sensors` stand in a whitened residual; in them a sample is a row of channels."""
        counts = (int(np.count_nonzero(self.sensor_mask(i, s))) * len(s.channels) for i, s in self.sensors)
        return blocks_of([self.samples, *counts])[1:]

    @cached_property
    def numbers(self) -> int:
        """Number of measured numbers: the rows of velocities that were measured, and those of sensors."""
        own = (np.count_nonzero(self.mask(i)) * np.count_nonzero(t.measured) for i, t in enumerate(self.trials))
        return int(sum(own)) + self.measured - self.samples

    @property
    def complete(self) -> bool:
        """Whether all three velocities of every trial were measured."""
        return all(bool(trial.measured.all()) for trial in self.trials)

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
        fields: dict[str, object] = {name: getattr(self, name) for name in ("noise", "ends", "slope_step", "smoothing")}
        if self.sensors:
            fields["sensor_sigma"] = {sensor.name: self.sigma_of(sensor) for _, sensor in self.sensors}
        return {key: plain(value) for key, value in fields.items()}

    def residual(self, x: FloatArray) -> FloatArray:
        """Return whitened residuals (measured - predicted): velocities of all trials, sensors of all, `deviation_rows`.

        Rows of velocities that were not measured are zero, here and in the derivatives.
        """
        measured = self._stack(self._run(x))
        return np.concatenate([measured, self.deviation_rows(x)[0]]) if self.with_priors else measured

    def raw(self, x: FloatArray) -> list[FloatArray]:
        """Return residuals (n_r, 3) of every trial's counted samples, in physical units; zero where not measured."""
        return self._counted_residuals(self._run(x))

    def raw_and_sensors(self, x: FloatArray) -> Slopes:
        """Return the residuals as one column, (n_r, 3, 1) a trial, and those of the sensors (m, 1), whitened."""
        predicted, one = self._run(x), np.zeros(1, dtype=np.intp)
        velocity = [block[:, :, None] for block in self._counted_residuals(predicted)]
        return Slopes(
            one, [one[:0]] * len(self.trials), velocity, [block[:, None] for block in self._sensor_residuals(predicted)]
        )

    def predictions(self, x: FloatArray) -> list[FloatArray]:
        """Return predicted velocities (n_r, 3) of every trial, all samples."""
        return [predicted.velocity for predicted in self._run(x)]

    def sensor_predictions(self, x: FloatArray) -> list[FloatArray]:
        """Return what each of `sensors` is predicted to read (m, c), all samples."""
        return [block for predicted in self._run(x) for block in predicted.sensors]

    def divergence(self, x: FloatArray) -> str:
        """Return which trial diverges, when and with which parameters; empty where none does."""
        predicted = [(trial, self.prediction(trial, self.named(x))) for trial in self.trials]
        lost = [(t, own, _Predicted(own.velocity, own.sensors).lost_in(t)) for t, own in predicted]
        return "; ".join(
            f"{t.name} {own.message}" if own.message else f"{at} is no number" for t, own, at in lost if at
        )

    def lost_row(self, residual: FloatArray) -> str:
        """Return where a whitened residual (n,) is not finite first: channel, trial and time [s] of a velocity."""
        runs = ((trial, trial.time[self.mask(i)]) for i, trial in enumerate(self.trials))
        places = [f"{name} of trial {run.name} at {t:.4g} s" for run, time in runs for t in time for name in CHANNELS]
        for (i, sensor), rows in zip(self.sensors, self.sensor_rows, strict=True):
            places += [f"{sensor.name} of trial {self.trials[i].name}"] * (rows.stop - rows.start)
        return [*places, "what was known beforehand"][min(int(np.argmax(~np.isfinite(residual))), len(places))]

    def jacobian(self, x: FloatArray) -> BlockAngular:
        """Return the derivative (n, p) of the whitened *prediction* by the free parameters; then `deviation_rows`."""
        shared, own, found = self._slopes_by_trial(x, self.parameters)
        return self._stacked(shared, own, (one for one, _ in found), self.measured).above(self.deviation_rows(x)[1])

    def jacobian_of(self, slopes: Slopes, x: FloatArray) -> BlockAngular:
        """Return the same of derivatives by all free parameters that are known already."""
        return self._measured_rows(slopes).above(self.deviation_rows(x)[1])

    def rows(self, slopes: Slopes) -> BlockAngular:
        """Return derivatives as rows (n, k) of the whitened residual: zeros in those of known parameters."""
        return self._measured_rows(slopes).above(np.zeros((len(self.with_priors), slopes.count)))

    def rows_by(self, x: FloatArray, names: Sequence[str], factors: FloatArray) -> tuple[FloatArray, Mapping[str, str]]:
        """Return derivatives by shared parameters times factors (k,) as such rows (n, k), and `Slopes.lost`.

        Of one trial after the other: all their derivatives would take the memory twice and thrice.
        """
        shared, own, found = self._slopes_by_trial(x, [p for p in self.parameters if p.name in names])
        lost: dict[str, str] = {}

        def scaled() -> Iterator[_Predicted]:
            for one, nowhere in found:
                lost.update({**nowhere, **lost})
                yield _Predicted(one.velocity * factors, tuple(block * factors for block in one.sensors))

        rows = self._stacked(shared, own, scaled(), self.measured).above(np.zeros((len(self.with_priors), len(shared))))
        return rows.shared, lost

    def velocity_rows(self, slopes: Slopes) -> BlockAngular:
        """Return derivatives as whitened rows (`samples`, k) of the velocities alone."""
        return self._stacked(
            slopes.shared, slopes.per_trial, (_Predicted(block, ()) for block in slopes.velocity), self.samples
        )

    def _measured_rows(self, slopes: Slopes) -> BlockAngular:
        """Return derivatives as whitened rows (`measured`, k) of velocities and sensors."""
        sensors = iter(slopes.sensors)
        pairs = zip(self.trials, slopes.velocity, strict=True)
        blocks = (_Predicted(block, tuple(next(sensors) for _ in trial.sensors)) for trial, block in pairs)
        return self._stacked(slopes.shared, slopes.per_trial, blocks, self.measured)

    def _stacked(
        self, places: IntArray, own: Sequence[IntArray], blocks: Iterable[_Predicted], rows: int
    ) -> BlockAngular:
        """Return whitened rows of the velocities, and those of sensors behind all, of the derivatives of each trial.

        Args:
            places, own: see `Slopes`.
            blocks: counted derivatives (n_r, 3, s + k_r) of each trial, and whitened ones (m, s + k_r) of its sensors.
            rows: number of rows.
        """
        count, parts, shared = len(places), [], np.zeros((rows, len(places)))
        of_sensors = iter(self.sensor_rows)
        for i, (one, mine, velocities) in enumerate(zip(blocks, own, self.rows_by_trial(), strict=True)):
            block = one.velocity
            white = [self.whitened(i, block).reshape(3 * len(block), block.shape[2]), *one.sensors]
            slices = [velocities, *(next(of_sensors) for _ in one.sensors)]
            at = np.concatenate([np.arange(s.start, s.stop) for s in slices])
            every = np.concatenate(white) if len(white) > 1 else white[0]
            shared[at] = every[:, :count]
            if len(mine):
                parts.append(Part(at, mine, every[:, count:].copy()))  # a view would keep the shared columns twice
        return BlockAngular(shared, places, tuple(parts))

    def whiten(self, blocks: Sequence[FloatArray]) -> FloatArray:
        """Whiten blocks (n_r, 3, k) of velocities, one a trial, and stack them to (`samples`, k)."""
        every = np.arange(blocks[0].shape[2])
        return self.velocity_rows(Slopes(every, [every[:0]] * len(blocks), [*blocks], [])).shared

    def whitened(self, index: int, block: FloatArray) -> FloatArray:
        """Whiten columns (n_r, 3, ...) of the counted samples of one trial."""
        if block.size == 0:  # filters refuse columns that are none
            return block
        return self.noise.whiten(self.trials[index], self.mask(index), block)

    def slopes(self, x: FloatArray, only: Collection[str] | None = None) -> Slopes:
        """Return the derivatives of velocities and sensors by the free parameters or those in `only`.

        Exact (`mjfish.model.sensitivity`); at a bound where the model changes its form, such as a servo without lag, a
        one-sided difference of second order over a tenth of the parameter's scale. Zero where not measured.
        """
        chosen = [p for p in self.parameters if only is None or p.name in only]
        shared, own, by_trial = self._slopes_by_trial(x, chosen)
        found = list(by_trial)
        velocity, sensors = [one.velocity for one, _ in found], [block for one, _ in found for block in one.sensors]
        lost = {name: place for _, lost in reversed(found) for name, place in lost.items()}
        return Slopes(shared, own, velocity, sensors, lost)

    def _slopes_by_trial(
        self, x: FloatArray, chosen: Sequence[Parameter]
    ) -> tuple[IntArray, list[IntArray], Iterator[tuple[_Predicted, dict[str, str]]]]:
        """Return `shared` and `own` of the slopes by some parameters; of each trial the others, and what is lost."""
        here = self.named(x)
        places: dict[str, list[int]] = {}
        for k, p in enumerate(chosen):
            places.setdefault(p.name.rpartition(":")[0], []).append(k)
        names = ("", *(trial.name for trial in self.trials))
        shared, *own = (np.array(places.get(name, []), dtype=np.intp) for name in names)

        def counted(index: int) -> tuple[_Predicted, dict[str, str]]:
            asked = [chosen[k] for k in (*shared, *own[index])]
            found = self._slopes(self.trials[index], here, asked)
            each = (
                _Predicted(found.velocity[..., k], tuple(b[..., k] for b in found.sensors)) for k in range(len(asked))
            )
            words = ((p.name, one.lost_in(self.trials[index])) for p, one in zip(asked, each, strict=True) if one.lost)
            lost = dict(words) if found.lost else {}  # before the derivatives become 0 there
            return self._counted(index, found), lost

        return shared, own, mapped(counted, range(len(self.trials)))

    def _counted(self, index: int, found: _Predicted) -> _Predicted:
        """Return the derivatives of one trial (n_r, 3, k) of counted samples, and whitened ones (m, k) of its sensors.

        Zero where not measured, or not reached.
        """
        trial = self.trials[index]
        velocity = np.nan_to_num(found.velocity[self.mask(index)], copy=False)
        if not trial.measured.all():
            velocity *= trial.measured[:, None]
        sensors = self.white_sensors(index, [np.nan_to_num(block, copy=False) for block in found.sensors])
        return _Predicted(velocity, tuple(b.reshape(b.shape[0] * b.shape[1], b.shape[2]) for b in sensors))

    def white_sensors(self, index: int, blocks: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the whitened columns (m, c, k) of the counted samples of each sensor of a trial, from all samples.

        Those before the window of a trial are given: errors of its joints are known by them.
        """
        sensors = self.trials[index].sensors
        sigma, begin = [self.sigma_of(s) for s in sensors], self._window(index)[0]
        errors, seen = self.errors_of_joints(index)
        white = [block[mask] for block, mask in zip(blocks, seen, strict=True)]
        white = errors(white) if errors else [block / own[:, None] for block, own in zip(white, sigma, strict=True)]
        return [b[s.time[mask] >= begin] for b, s, mask in zip(white, sensors, seen, strict=True)]

    def errors_of_joints(self, index: int) -> tuple[Whitening | None, list[BoolArray]]:
        """Return what whitens the sensors of a trial for errors of its joints, and the samples (m,) it was made of.

        None where these errors do not matter, or velocities allow for them, or the run diverged.
        """
        trial = self.trials[index]
        seen = [self._between(index, sensor, -np.inf, self._window(index)[1]) for sensor in trial.sensors]
        if self.joint_errors is None:
            return None, seen
        return self.joint_errors(trial, [self.sigma_of(sensor) for sensor in trial.sensors], seen), seen

    def explained(self, index: int, left: Sequence[FloatArray]) -> list[FloatArray]:
        """Return by how much errors of its joints move the sensors of a trial (m, c), as far as they are known.

        That is by the samples before its window; where they are not allowed for, by nothing.

        Args:
            index: of the trial.
            left: (m, c) what a prediction leaves of each sensor.
        """
        sensors, begin = self.trials[index].sensors, self._window(index)[0]
        if self.joint_errors is None or begin == -np.inf:
            return [np.zeros_like(block) for block in left]
        errors = self.joint_errors(
            self.trials[index],
            [self.sigma_of(s) for s in sensors],
            [self._between(index, s, -np.inf, np.nextafter(begin, -np.inf)) for s in sensors],
        )
        return [np.zeros_like(block) for block in left] if errors is None else errors.explained(left)

    def _slopes(self, trial: Trial, here: Mapping[str, float], chosen: Sequence[Parameter]) -> _Predicted:
        """Return the derivatives (n, 3, k), (m, c, k) of one trial's prediction by parameters of it or shared."""
        check_time()
        own = {k: p.name.removeprefix(f"{trial.name}:") for k, p in enumerate(chosen)}
        model = self._sloping
        rough = [k for k, name in own.items() if one_sided(model, name, here[chosen[k].name])]
        exact = [k for k in own if k not in rough]
        slopes, read = with_sensors(
            model, clocks.clocked(trial, here), here, [own[k] for k in exact], **self._trial_arguments(trial, here)
        )
        for column, k in enumerate(exact):
            if own[k] == clocks.SCALE:  # derived relative to the scale that the wave has
                for block in (slopes, *read):
                    block[:, :, column] /= here[chosen[k].name]
        found = _Predicted(self._smoothed(trial, slopes), read)
        if not rough:
            return found
        blocks = [np.zeros((*block.shape[:2], len(chosen))) for block in found.blocks]
        for whole, block in zip(blocks, found.blocks, strict=True):
            whole[:, :, exact] = block
        base = self._predict((trial, dict(here)))
        for k in rough:
            name, h = chosen[k].name, 0.1 * chosen[k].scale
            near, far = (self._predict((trial, {**here, name: here[name] + by})) for by in (h, 2.0 * h))
            for whole, *three in zip(blocks, near.blocks, base.blocks, far.blocks, strict=True):
                whole[:, :, k] = (2.0 * three[0] - 1.5 * three[1] - 0.5 * three[2]) / h
        return _Predicted(blocks[0], tuple(blocks[1:]))

    @cached_property
    def _sloping(self) -> Model:
        """The model that is derived."""
        return self.model if self.slope_step is None else replace(self.model, step=self.slope_step)

    @property
    def rough(self) -> Problem:
        """The same by the step of the derivatives throughout: for residuals that are compared with one another only."""
        return replace(self, model=self._sloping)

    @property
    def smoother(self) -> Problem:
        """The same along the best guess of measured joint angles, where their errors are allowed for.

        A prediction has the noise of the joint angles. A derivative along the same angles has the same noise. The two
        correlate, and scores are larger than by chance [Carroll2006]. The best guess of the angles has less noise.

        [Carroll2006] R. Carroll, D. Ruppert, L. Stefanski and C. Crainiceanu, Measurement Error in Nonlinear Models.
        """
        return self if self.joint_errors is None else replace(self, model=replace(self.model, penalty_share=1.0))

    def mask(self, index: int) -> BoolArray:
        """Return which samples (n_r,) of a trial count.

        Left out are the samples next to a step of the drive, where the velocity jumps and a reading depends on which
        side of the step it fell; where the joints were measured, the ends: a shifted clock would ask for motion
        that nobody saw; `ends`; and where velocities were smoothed, what the filter feels of such a step or of an end.
        None counts of a trial without any velocity.
        """
        trial = self.trials[index]
        reach = self.smoothing.reach(trial.step) if self.smoothing is not None else 0.0
        keep = self._inside(index, trial.time, 1.5 * trial.step + reach, *self._window(index), margin=reach)
        keep[: self.ends] = keep[len(keep) - self.ends :] = False
        return np.asarray(keep & trial.measured.any())

    def sensor_mask(self, index: int, sensor: Sensor) -> BoolArray:
        """Return which samples (m,) of a sensor of a trial count: those within it, not beside a step of the drive.

        Nor at the ends of measured joint angles, or outside of the window.
        """
        return self._between(index, sensor, *self._window(index))

    def _window(self, index: int) -> tuple[float, float]:
        window = self.windows[index] if self.windows is not None else None
        return (-np.inf, np.inf) if window is None else window

    def _between(self, index: int, sensor: Sensor, begin: float, end: float) -> BoolArray:
        """Return which samples (m,) of a sensor would count, were this the window."""
        return self._inside(index, sensor.time, 1.5 * sensor.step, begin, end, margin=-1e-9)

    def _inside(
        self, index: int, time: FloatArray, beside: float, begin: float, end: float, margin: float
    ) -> BoolArray:
        """Return which times (m,) are in a window, not beside a step of the drive of a trial, nor at its ends.

        These are as long as a margin [s], and where the joints were measured as `MARGIN`.
        """
        trial = self.trials[index]
        if trial.joint_angle is not None:
            margin = max(margin, MARGIN)
        begin, end = max(begin, trial.time[0] + margin), min(end, trial.time[-1] - margin)
        keep = np.asarray((time >= begin) & (time <= end))
        for segment in trial.drive[1:]:
            keep &= np.abs(time - segment.start) > beside
        return keep

    def sigma_of(self, sensor: Sensor) -> FloatArray:
        """Return the standard deviation (c,) of one sample of a sensor: the stated one, else the estimated."""
        return self.sensor_sigma[sensor.name] if sensor.sigma is None else sensor.sigma

    def rows_by_trial(self) -> list[slice]:
        """Return where the rows of the velocities of each trial stand in a whitened residual."""
        return blocks_of([len(CHANNELS) * int(np.count_nonzero(self.mask(i))) for i in range(len(self.trials))])

    @cached_property
    def trial_rows(self) -> list[IntArray]:
        """Where the rows of each trial, of velocities and of sensors, stand in a whitened residual."""
        rows = [[np.arange(part.start, part.stop)] for part in self.rows_by_trial()]
        for (i, _), part in zip(self.sensors, self.sensor_rows, strict=True):
            rows[i].append(np.arange(part.start, part.stop))
        return [np.concatenate(own) for own in rows]

    def start(self, given: Mapping[str, float] | None = None) -> FloatArray:
        """Return the start vector: `given` by name where it has one, else each parameter's declared start."""
        return np.array([(given or {}).get(p.name, p.start) for p in self.parameters])

    def named(self, x: FloatArray) -> dict[str, float]:
        """Return free and fixed parameters by name."""
        return {**self.fixed, **{p.name: float(v) for p, v in zip(self.parameters, x, strict=True)}}

    def _stack(self, predicted: list[_Predicted]) -> FloatArray:
        white = [self.whitened(i, left).ravel() for i, left in enumerate(self._counted_residuals(predicted))]
        velocities = [np.full_like(w, LOST) if own.lost else w for w, own in zip(white, predicted, strict=True)]
        return np.concatenate([*velocities, *(self._sensor_residuals(predicted) if self.sensors else ())])

    def _counted_residuals(self, predicted: list[_Predicted]) -> list[FloatArray]:
        """Return residuals (n_r, 3) of every trial's counted samples, in physical units; zero where not measured."""
        pairs = enumerate(zip(self.trials, predicted, strict=True))
        return [velocity_residual(trial, own.velocity)[self.mask(i)] for i, (trial, own) in pairs]

    def _sensor_residuals(self, predicted: list[_Predicted]) -> list[FloatArray]:
        """Return whitened residuals (m,) of each sensor."""

        def of_trial(index: int) -> list[FloatArray]:
            sensors, own = self.trials[index].sensors, predicted[index]
            left = [(one.values - block)[:, :, None] for one, block in zip(sensors, own.sensors, strict=True)]
            white = [block.ravel() for block in self.white_sensors(index, left)]
            return [np.full_like(block, LOST) for block in white] if own.lost else white

        return [block for blocks in mapped(of_trial, range(len(self.trials))) for block in blocks]

    def _run(self, x: FloatArray) -> list[_Predicted]:
        check_time()
        values = self.named(x)
        return list(mapped(self._predict, [(trial, values) for trial in self.trials]))

    def _predict(self, task: tuple[Trial, dict[str, float]]) -> _Predicted:
        check_time()
        prediction = self.prediction(*task)
        return _Predicted(self._smoothed(task[0], prediction.velocity), prediction.sensors)

    def _smoothed(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Return predicted columns (n_r, 3, ...) as the recording of the trial would have them."""
        if self.smoothing is None or block.size == 0 or not np.all(np.isfinite(block)):
            return block
        return self.smoothing.of_trial(trial, block)

    def prediction(self, trial: Trial, values: Mapping[str, float]) -> Prediction:
        """Predict one trial, its start and its clocks from `values` where they are free."""
        return self.model.predict(clocks.clocked(trial, values), values, **self._trial_arguments(trial, values))

    @staticmethod
    def _trial_arguments(trial: Trial, values: Mapping[str, float]) -> dict[str, Any]:
        """Return what `Model.predict` takes of a trial alone: velocity and pose at the start, clock offsets."""
        velocity, pose = None, None
        if trial.free_start:
            velocity = np.array([values[f"{trial.name}:start.{channel}"] for channel in CHANNELS])
        if any(sensor.kind in _SEES_POSE for sensor in trial.sensors):
            measured = np.zeros(3) if trial.pose is None else np.nan_to_num(trial.pose[0])
            pose = np.array(
                [values.get(f"{trial.name}:start.{name}", float(v)) for name, v in zip(POSE, measured, strict=True)]
            )
        return {
            "velocity": velocity,
            "offset": values.get(f"{trial.name}:clock.offset", 0.0),
            "pose": pose,
            "sensor_offsets": {s.name: values.get(f"{trial.name}:{s.clock}", 0.0) for s in trial.sensors},
        }


#: Sensors that see where the run began, and its heading there.
_SEES_POSE = {"position": POSE, "heading": POSE[2:]}


def velocity_residual(trial: Trial, predicted: FloatArray) -> FloatArray:
    """Return measured less predicted velocities (n, 3), zero of those that were not measured."""
    if trial.measured.all():
        return np.asarray(trial.velocity - predicted)
    return np.where(trial.measured, trial.velocity - predicted, 0.0)


def nuisances(trial: Trial, free_clock: bool, walk: float = 0.0) -> tuple[Parameter, ...]:
    """Return what must be fitted in this trial alone.

    Start velocity and clock offsets where they are free, frequency and phase of a wave with a clock of its own, the
    modes of its clock's walk, and what sensors see of the pose at the start.
    """
    declared = []
    if trial.free_start:
        rows = zip(CHANNELS, _START_SCALE, _START_RANGE, _START_SD, trial.first_velocity, strict=True)
        for channel, scale, reach, sd, measured in rows:
            centre = float(np.nan_to_num(measured))
            own = _at_start(f"{trial.name}:start.{channel}", UNITS[channel], centre, reach, scale)
            declared.append(own if np.isnan(measured) else replace(own, sd=sd))
    if free_clock:
        declared.append(
            Parameter(f"{trial.name}:clock.offset", "s", 0.0, -0.25, 0.25, 0.0, _CLOCK_SCALE, about="clock offset")
        )
    return (*declared, *clocks.parameters(trial), *clocks.walk(trial, walk), *_of_sensors(trial))


def _at_start(name: str, unit: str, centre: float, reach: float, scale: float) -> Parameter:
    return Parameter(name, unit, centre, centre - reach, centre + reach, centre, scale, about="at the start")


def _of_sensors(trial: Trial) -> Iterator[Parameter]:
    """Yield the pose at the start, as far as sensors see it, and the offsets of their clocks."""
    seen = {name for sensor in trial.sensors for name in _SEES_POSE.get(sensor.kind, ())}
    for name, centre, scale, reach in zip(POSE, _first_pose(trial), _POSE_SCALE, _POSE_RANGE, strict=True):
        if name in seen:
            yield _at_start(f"{trial.name}:start.{name}", columns.UNITS[name], centre, reach, scale)
    for sensor in trial.sensors:
        if sensor.free_clock:
            yield Parameter(
                f"{trial.name}:{sensor.clock}",
                "s",
                0.0,
                -_CLOCK_RANGE,
                _CLOCK_RANGE,
                0.0,
                _CLOCK_SCALE,
                about=f"clock offset of {sensor.name}",
            )


def _first_pose(trial: Trial) -> tuple[float, float, float]:
    """Return a first guess of x, y [m], yaw [rad] at the start: as measured, else by the first part of a track."""
    measured = np.full(3, np.nan) if trial.pose is None else trial.pose[0]
    tracks, headings = ([s.values for s in trial.sensors if s.kind == kind] for kind in ("position", "heading"))
    moved = [track[int(_FIRST_PART * len(track))] - track[0] for track in tracks]
    places = [measured[:2], *(track[0] for track in tracks)]
    yaws = [measured[2], *(heading[0, 0] for heading in headings), *(np.arctan2(y, x) for x, y in moved)]
    x, y = next((place for place in places if not np.isnan(place[0])), places[0])
    yaw = next((angle for angle in yaws if not np.isnan(angle)), np.nan)
    return float(np.nan_to_num(x)), float(np.nan_to_num(y)), float(np.nan_to_num(yaw))
