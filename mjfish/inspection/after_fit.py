"""Tests of the data that need the nominal fit: clocks, outlying runs, differentiated velocities, labels again.

Clock: the measured run is compared with the simulated one shifted by whole samples; the shift may be constant, change
once, or drift. Lost frames make it change once by as many samples as were lost, which no force does.

Outlying run: leaving run r out moves the estimates by one Gauss-Newton step, x_-r = x + (J_-r' J_-r)^-1 J_-r' e_-r, and
the residuals with them. No fit is run.

Differentiated velocities: positions with white noise, differentiated, leave noise that rises with frequency; a
Savitzky-Golay filter of m samples bends it down again, with zeros that show m. Each is a spectrum S(f) = a |H(f)|^2 +
b; the best by Whittle's likelihood, - sum log S + I / S over the periodogram I, is taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from mjfish.arrays import FloatArray, checked, project_out, robust_sigma
from mjfish.data import Trial
from mjfish.effects import Effect
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.frames import CHANNELS
from mjfish.inspection.finding import Finding
from mjfish.inspection.nominal_simulation import costs, labels, sampled_enough
from mjfish.inspection.result import Inspection
from mjfish.inspection.runs import beats
from mjfish.noise.differentiation import weights

#: Shifts that are tried, in samples; a CPG goes on for a quarter of a second behind the last sample.
SHIFTS = np.arange(-6, 13)
#: A changing shift must leave less than this share of the misfit that a constant one leaves.
SHARE = 0.6
#: A run whose mean square, all three channels together, is below this one in units of sigma is on time.
_FITS = 4.0
#: Share of the samples that must lie to either side of a jump.
_SIDE = 0.08
#: A whitened residual counts as this many sigma at most: one far sample makes no bad run.
_CAP = 4.0
#: How many times worse than a run of the same drive, over the stretch they share, an odd run is.
_SUSPECT = 4.0
#: How many times worse than the next worst run an odd run is that no other run can be compared with.
_REMARK = 5.0
#: Samples over which two runs of one drive are compared at least.
_COMPARED = 30
#: Windows of Savitzky-Golay filters that are tried, and the orders of their polynomials that differ.
_WINDOWS = (3, 5, 7, 9, 11, 13, 15, 17, 21, 25, 31)
_FILTERS = tuple((window, order) for window in _WINDOWS for order in (2, 4) if window > order)
#: Shares of white noise beside the filtered.
_WHITE = (0.0, 1e-4, 1e-3, 1e-2, 0.05, 0.2)
#: Log-likelihood by which a way of making must beat all others of another kind.
_CLEAR = 20.0
#: Spectra are made of runs of this many samples or more.
_LONG = 128
#: Beats after a start or a step that are left out of them.
_BEATS = 3.0


def inspect_fit(problem: Problem, fit: Fit, effects: Mapping[str, Effect], held: Sequence[Trial] = ()) -> Inspection:
    """Check a dataset against its nominal fit.

    Args:
        problem: of the nominal model; its noise should be that of the data, coloured where they are.
        fit: of it.
        effects: the causes that may be asked for, by name.
        held: trials that were held out: they are looked at for their labels and clocks.

    Returns:
        Findings; none where the fit diverged, for then nothing can be taken away, or where no velocity was measured.
    """
    if fit.lost or not problem.samples:
        return Inspection()
    values = {**problem.fixed, **fit.values}
    shared = {p.name: values[p.name] for p in problem.model.parameters}
    residuals = problem.raw(fit.x)
    sigma = np.median([robust_sigma(r) for r in residuals], axis=0) + 1e-12
    trials = [trial for trial in (*problem.trials, *held) if trial.drive and sampled_enough(trial)]
    found: list[Finding] = []
    found += _labels(problem, trials, shared, sigma)
    wrong = {name for finding in found for name in finding.trials}
    for trial in trials:
        if trial.name not in wrong:
            offset = values.get(f"{trial.name}:clock.offset", 0.0)
            found += clock(trial, _shifted(problem, trial, shared, offset), sigma)
    wrong = {name for finding in found for name in finding.trials}
    found += [finding for finding in outlying_run(problem, fit) if not wrong & set(finding.trials)]
    if not wrong:
        settled = [_settled(problem, i, residual) for i, residual in enumerate(residuals)]
        settled = [(trial, residual) for trial, residual in settled if len(residual) >= _LONG]
        steps, frequencies = [trial.step for trial, _ in settled], [beats(trial) for trial, _ in settled]
        found += differentiated(noise_spectra([residual for _, residual in settled], steps, frequencies))
    return Inspection.of(found, effects)


def _settled(problem: Problem, index: int, residual: FloatArray) -> tuple[Trial, FloatArray]:
    """Return a trial and its residual without what follows a start or a step, where a misfit has every frequency."""
    trial = problem.trials[index]
    if trial.gaps:
        return trial, residual[:0]
    if not trial.drive:
        return trial, residual
    last = trial.drive[-1]
    return trial, residual[trial.time[problem.mask(index)] > last.start + _BEATS * 2.0 * np.pi / last.omega]


def _labels(problem: Problem, trials: Sequence[Trial], values: dict[str, float], sigma: FloatArray) -> list[Finding]:
    drives = list(dict.fromkeys(trial.drive for trial in trials))
    if len(drives) < 2:
        return []
    return list(labels(trials, drives, costs(problem.model, trials, drives, values, sigma=sigma), fitted=True))


def _shifted(problem: Problem, trial: Trial, values: dict[str, float], offset: float) -> FloatArray:
    """Return the prediction (shifts, n, 3) at the times of a trial, shifted by whole samples."""
    predicted = problem.model.predict(trial, values, offset=offset)
    rollout = predicted.rollout
    if rollout.status != "ok":
        return np.full((len(SHIFTS), len(trial.time), 3), np.nan)
    step = trial.step
    when = problem.model.prepare(trial, values, offset=offset).time[None, :] + SHIFTS[:, None] * step
    inside = np.clip(when, rollout.time[0], rollout.time[-1])
    return np.asarray(rollout.at(inside.ravel())[:, :3].reshape(*when.shape, 3))


def clock(trial: Trial, shifted: FloatArray, sigma: FloatArray) -> Iterator[Finding]:
    """Find a jump or a drift of the clock.

    Args:
        trial: driven by a CPG.
        shifted: (shifts, n, 3) simulated at trial.time + `SHIFTS` times the sampling interval.
        sigma: (3,) that misfits are divided by.
    """
    misfit = np.sum(((trial.velocity - shifted) / sigma) ** 2, axis=2)
    total = misfit.sum(axis=1)
    n = misfit.shape[1]
    side = max(int(_SIDE * n), 10)
    if n < 4 * side or not np.all(np.isfinite(total)) or total.min() < _FITS * n:
        return
    before = np.cumsum(misfit, axis=1)[:, side : n - side]
    after = total[:, None] - before
    joined = before.min(axis=0) + after.min(axis=0)
    at = int(np.argmin(joined))
    first, second = int(np.argmin(before[:, at])), int(np.argmin(after[:, at]))
    jump = int(SHIFTS[second] - SHIFTS[first])
    constant = float(total.min())
    drifting, ends = _drift(misfit)
    if min(float(joined[at]), drifting) > SHARE * constant:
        return
    step = trial.step
    when = float(trial.time[side + at])
    if drifting < joined[at]:
        share = (SHIFTS[ends[1]] - SHIFTS[ends[0]]) * step / float(np.ptp(trial.time))
        yield Finding(
            "clock-drift",
            "suspect",
            f"trial '{trial.name}', time",
            f"the run's clock drifts against the command by {share:+.2%}",
            "one clock, or two at the same rate",
            "correct the frame rate, or the frequency of the drive",
            trials=(trial.name,),
        )
    elif jump:
        what = f"{jump} frames were lost" if jump > 0 else f"{-jump} frames were counted twice"
        yield Finding(
            "clock-jump",
            "blocks" if abs(jump) > 1 else "suspect",
            f"trial '{trial.name}', time {when:.2f} s",
            f"about {what} there: from then on the run is {abs(jump) * step:.3f} s "
            f"{'ahead of' if jump > 0 else 'behind'} its command",
            "times that go on evenly with the command",
            "number the frames by their time stamps and say gaps = true, or cut the run there",
            trials=(trial.name,),
        )


def _drift(misfit: FloatArray) -> tuple[float, tuple[int, int]]:
    """Return the least misfit with a shift that goes evenly from one to another, and the two (indices)."""
    shifts, n = misfit.shape
    share = np.linspace(0.0, 1.0, n)
    best, ends = np.inf, (0, 0)
    for a in range(shifts):
        for b in range(shifts):
            if abs(a - b) < 2:
                continue
            at = np.rint(a + (b - a) * share).astype(np.intp)
            here = float(misfit[at, np.arange(n)].sum())
            if here < best:
                best, ends = here, (a, b)
    return best, ends


def outlying_run(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Find a run that is far worse than the rest."""
    trials = problem.trials
    if len(trials) < 3:
        return
    small = _Others.of(problem, fit)
    worst = int(np.argmax([_size(small.residual(r, small.step(r))) for r in range(len(trials))]))
    moved = small.step(worst)
    residuals = [small.residual(r, moved) for r in range(len(trials))]
    level = np.array([_size(residual) for residual in residuals])
    twins = [(_shared(problem, residuals, worst, k), k) for k in range(len(trials)) if k != worst]
    compared = [(ratio, k) for ratio, k in twins if ratio is not None]
    if compared:
        ratio, twin = min(compared)
        if ratio > _SUSPECT:
            yield Finding(
                "outlying-run",
                "suspect",
                f"trial '{trials[worst].name}'",
                f"its misfit is {ratio:.0f} times that of '{trials[twin].name}' under the same drive, with the "
                "coefficients fitted without it",
                "runs of one drive that differ by noise alone",
                "look at this run: another clock, scale, charge of the battery, or something in its way; diagnose "
                "without it",
                trials=(trials[worst].name,),
            )
        return
    others = np.delete(level, worst)
    if level[worst] > _REMARK * others.max():
        yield Finding(
            "outlying-run-alone",
            "remark",
            f"trial '{trials[worst].name}'",
            f"its misfit per sample is {level[worst] / np.median(others):.0f} times that of the other runs, with the "
            "coefficients fitted without it; no other run has its drive",
            "misfits of one size",
            "repeat this run: alone, it cannot be told from a cause that shows only under its drive",
            trials=(trials[worst].name,),
        )


@dataclass(frozen=True, eq=False)
class _Others:
    """A fit in few numbers by run, in which the parameters of that run alone are eliminated.

    Attributes:
        velocities: (m, 3) whitened residual of every run, and (3 m, s) its derivative by the shared parameters, both
            less what its own parameters explain.
        factors: of every run, the shared derivative (k, s) and the residual (k,) in an orthonormal basis.
    """

    velocities: tuple[tuple[FloatArray, FloatArray], ...]
    factors: tuple[tuple[FloatArray, FloatArray], ...]

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> _Others:
        jacobian = fit.jacobian.chosen(~fit.at_bound).top(problem.samples)
        velocities, factors = [], []
        for rows in problem.rows_by_trial():
            own, shared = jacobian.at(np.arange(rows.start, rows.stop))
            basis, _ = np.linalg.qr(own)
            shared, e = project_out(basis, shared), project_out(basis, fit.residual[rows])
            q, r = np.linalg.qr(shared)
            velocities.append((e, shared))
            factors.append((r, q.T @ e))
        return cls(tuple(velocities), tuple(factors))

    def residual(self, r: int, step: FloatArray) -> FloatArray:
        """Return the residual (m, 3) of run r once the shared parameters have moved by a step (s,)."""
        e, shared = self.velocities[r]
        return np.asarray((e - shared @ step).reshape(-1, 3))

    def step(self, without: int) -> FloatArray:
        """Return how the shared parameters (s,) move without a run; a direction that no other run sees is not moved."""
        kept = [pair for k, pair in enumerate(self.factors) if k != without]
        design, left = (np.concatenate([pair[i] for pair in kept]) for i in (0, 1))
        return checked(np.linalg.lstsq(design, left, rcond=1e-6)[0])


def _size(residual: FloatArray) -> float:
    return float(np.mean(np.minimum(residual**2, _CAP**2)))


def _shared(problem: Problem, residuals: Sequence[FloatArray], worst: int, other: int) -> float | None:
    """Return how many times worse `worst` is than `other` while both had one drive; None where they never had."""
    until = _same_drive_until(problem.trials[worst], problem.trials[other])
    if until is None:
        return None
    here = [residuals[k][_times(problem, k, len(residuals[k])) < until] for k in (worst, other)]
    if min(len(part) for part in here) < _COMPARED:
        return None
    return _uncapped(here[0]) / max(_uncapped(here[1]), 1e-12)


def _uncapped(residual: FloatArray) -> float:
    """Mean square without the largest two per cent."""
    squares = np.sort((residual**2).ravel())
    return float(np.mean(squares[: max(int(0.98 * len(squares)), 1)]))


def _times(problem: Problem, index: int, rows: int) -> FloatArray:
    """Return the times (rows,) of the whitened rows of a trial; with gaps the first of each stretch are not counted."""
    time = problem.trials[index].time[problem.mask(index)]
    return np.asarray(time[len(time) - rows :])


def _same_drive_until(a: Trial, b: Trial) -> float | None:
    """Return until when two runs have the same drive from the start [s]; None where they differ at once."""
    if not a.drive or not b.drive or a.drive[0] != b.drive[0]:
        return None
    ends = [trial.drive[1].start if len(trial.drive) > 1 else float(trial.time[-1]) for trial in (a, b)]
    return float(a.time[-1]) if a.drive == b.drive else min(ends)


@dataclass(frozen=True)
class NoiseSpectrum:
    """The best account of a channel's noise.

    Attributes:
        channel: its name.
        kind: ``white``, ``differentiated``, ``drifting`` (autoregressive of order 1 to 3), or ``unclear``.
        window: samples of the filter, where it was differentiated; 0 else.
        order: of the filter's polynomial.
    """

    channel: str
    kind: str
    window: int = 0
    order: int = 0


def noise_spectra(
    residuals: Sequence[FloatArray], intervals: Sequence[float], beats: Sequence[Sequence[float]]
) -> list[NoiseSpectrum]:
    """Say how the velocities were made, channel by channel.

    Args:
        residuals: (n, 3) a trial, at equal intervals, without gaps.
        intervals: between samples [s].
        beats: frequencies [Hz] of the beats of each trial: lines beside them and their harmonics are left out.
    """
    found = []
    shapes: dict[tuple[int, int], FloatArray] = {}
    for channel, name in enumerate(CHANNELS):
        waves = [_periodogram(r[:, channel], dt, f) for r, dt, f in zip(residuals, intervals, beats, strict=True)]
        phase, power = (np.concatenate(parts) for parts in zip(*waves, strict=True)) if waves else (np.zeros(0),) * 2
        if not shapes:  # the phases are those of every channel
            shapes.update({key: _differentiated(phase, *key) for key in _FILTERS})
        found.append(_best(name, phase, power, shapes))
    return found


def differentiated(found: Sequence[NoiseSpectrum]) -> Iterator[Finding]:
    """Yield a remark for each filter by which channels were differentiated."""
    filtered = [spectrum for spectrum in found if spectrum.kind == "differentiated"]
    for window, order in dict.fromkeys((spectrum.window, spectrum.order) for spectrum in filtered):
        names = tuple(spectrum.channel for spectrum in filtered if (spectrum.window, spectrum.order) == (window, order))
        yield Finding(
            "velocity-differentiated",
            "remark",
            " and ".join(names),
            f"the noise has the spectrum of differentiated positions, smoothed by a filter of {window} samples "
            f"(Savitzky-Golay, order {order}, or like it)",
            "noise of a velocity that was measured",
            "fit with coloured noise; the filter also delays and rounds what it smooths, so give the positions if you "
            "can; a filter that is not centred looks like a clock offset of half its length",
            channels=names,
        )


def _periodogram(values: FloatArray, interval: float, beats: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return phases (m,) [rad a sample] and powers (m,) away from zero and from the harmonics of the beat."""
    frequency, power = signal.periodogram(values, 1.0 / interval, window="hann", detrend="constant")
    keep = frequency > 3.0 / (len(values) * interval)
    wide = max(0.35, 2.5 / (len(values) * interval))  # a line is two of 1 / duration wide to either side
    for beat in beats:
        for harmonic in range(1, int(0.5 / (interval * beat)) + 1):
            keep &= np.abs(frequency - harmonic * beat) > wide
    keep[-1] = False
    return 2.0 * np.pi * frequency[keep] * interval, power[keep]


def _best(
    name: str, phase: FloatArray, power: FloatArray, shapes: Mapping[tuple[int, int], FloatArray]
) -> NoiseSpectrum:
    if len(phase) < 60 or not np.all(power > 0.0):
        return NoiseSpectrum(name, "unclear")
    # Each kind by its likelihood less what its parameters cost; Hann windows leave about two thirds of the freedom.
    cost = 0.5 * np.log(len(phase))
    derived = {key: max(_whittle(power, shape, w) for w in _WHITE) - 2.0 * cost for key, shape in shapes.items()}
    best = max(derived, key=lambda key: derived[key])
    kinds = {"white": _whittle(power, np.ones_like(phase), 0.0), "drifting": _autoregressive(phase, power, cost)}
    kinds["differentiated"] = derived[best]
    kind = max(kinds, key=lambda key: kinds[key])
    if kind == "differentiated":
        clear = kinds[kind] - max(kinds["white"], kinds["drifting"]) > _CLEAR
        return NoiseSpectrum(name, kind, *best) if clear else NoiseSpectrum(name, "unclear")
    return NoiseSpectrum(name, kind)


def _whittle(power: FloatArray, shape: FloatArray, white: float) -> float:
    """Return the likelihood of a spectrum of this shape with a share of white noise, its level profiled out."""
    spectrum = shape / shape.mean() + white
    level = float(np.mean(power / spectrum))
    return float(-np.sum(np.log(level * spectrum)) - len(power))


def _differentiated(phase: FloatArray, window: int, order: int) -> FloatArray:
    return np.asarray(np.abs(signal.freqz(weights(window, order), worN=phase)[1]) ** 2 + 1e-12)


def _autoregressive(phase: FloatArray, power: FloatArray, cost: float) -> float:
    """Return the best likelihood of autoregressive spectra of order 1 to 3 with a share of white noise."""
    best = -np.inf
    lags = np.arange(4)
    covariance = np.cos(phase[:, None] * lags).T @ power
    for order in (1, 2, 3):
        toeplitz = covariance[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
        phi = checked(np.linalg.lstsq(toeplitz, covariance[1 : order + 1])[0])
        response = np.abs(1.0 - np.exp(-1j * phase[:, None] * lags[1 : order + 1]) @ phi) ** 2
        best = max(best, max(_whittle(power, 1.0 / response, w) for w in _WHITE) - (order + 1) * cost)
    for pole in (0.8, 0.9, 0.95, 0.98, 0.99):
        shape = 1.0 / np.abs(1.0 - pole * np.exp(-1j * phase)) ** 2
        best = max(best, max(_whittle(power, shape, w) for w in (*_WHITE, 0.5, 1.0, 2.0)) - 2.0 * cost)
    return float(best)
