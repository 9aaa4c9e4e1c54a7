"""How late the joints are with fitted servo dynamics, whatever its form: a size that a person understands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from mjfish.data import Trial
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.table import Estimate, linearised
from mjfish.effects import Effect
from mjfish.effects.effect import ServoForm
from mjfish.estimation.omnibus import beat_phase
from mjfish.model.model import driven, requested_motion
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import number

#: A phase that is this far ahead [rad], as that of next to no delay may be by rounding, is not almost a beat behind.
_AHEAD = 0.5


def servo_delays(refit: Refit) -> dict[str, Estimate]:
    """Return the phase delay of the last joint behind its command [ms], by beat frequency; none without servo dynamics.

    Phase over angular frequency, in the fitted runs of the slowest and of the fastest beat.
    """
    servos = tuple(effect for effect in refit.effects if effect.mechanism == ServoForm.mechanism)
    phases = [(beat_phase(refit.problem.model.fish.cpg, trial), trial) for trial in refit.problem.trials if servos]
    inner = [slice(len(phase) // 2, -len(phase) // 10) for phase, _ in phases]  # a Hilbert phase errs at the end
    rates = [float(np.polyfit(t.time[own], phase[own], 1)[0]) for (phase, t), own in zip(phases, inner, strict=True)]
    found = {}
    for rate in sorted({min(rates), max(rates)} if rates else ()):
        lags = partial(_lags, refit, servos, *phases[rates.index(rate)], rate)
        (delay,), (half,), _ = linearised(refit.fit, [p for effect in servos for p in effect.parameters], lags)
        found[f"{number(rate / (2.0 * np.pi))} Hz"] = Estimate(delay, delay - half, delay + half, "ms")
    return found


def _lags(
    refit: Refit, servos: Sequence[Effect], phase: FloatArray, trial: Trial, rate: float, values: Mapping[str, float]
) -> FloatArray:
    """Return the delay (1,) [ms] of the beat in the second half of a run, where starts and steps have died away."""
    everything = {**refit.problem.fixed, **values}
    asked = requested_motion(refit.problem.model.fish.cpg, trial, refit.problem.model.step)
    got = driven(asked, tuple((effect, tuple(effect.short_values(everything).items())) for effect in servos))
    later = asked.time[1:] > 0.5 * (trial.time[0] + trial.time[-1])
    beat = np.hanning(later.sum()) * np.exp(-1j * np.interp(asked.time[1:][later], trial.time, phase))
    lag = np.angle((beat @ asked.angle[later, 2, -1]) / (beat @ got.angle[later, 2, -1]))
    return np.array([1e3 * ((lag + _AHEAD) % (2.0 * np.pi) - _AHEAD) / rate])
