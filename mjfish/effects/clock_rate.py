"""Rate of the clock of the drive, by the clock of the camera."""

from __future__ import annotations

from mjfish.data import Dataset, Trial
from mjfish.effects.calibration import SYNC_FLASH
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class ClockRate(Effect):
    """What is recorded at t happened at (1 + e) t by the clock of the drive: V_recorded(t) = (1 + e) V((1 + e) t).

    The camera's clock is slow by e, or the drive beats faster by e than it was told. Motion cannot tell the two apart:
    drag and added mass are of second order in the rates, so that a fish which beats faster swims the same path.
    """

    name, domain, mechanism = "clock_rate", "data", "clock"
    summary = "the clock of the camera and that of the drive do not run at one rate"
    parameters = (
        Parameter("clock_rate.error", "-", 0.0, -0.05, 0.05, 0.0, 0.002, about="recorded at t, happened at (1 + e) t"),
    )
    source = "Data compatibility check, Jategaonkar, Flight Vehicle System Identification (2006), ch. 10"
    signature = "the beat runs ahead of that of the model or falls behind, by a phase that grows with the time"
    confirm = "count the beats in a film of a minute, or film a stopwatch beside the clock of the drive"
    fingerprint = Fingerprint(exponent=1.0, odd=False, part="steady")
    calibration = SYNC_FLASH
    resembles = ("clock-drift", "clock-jump", "compatibility-derived", "compatibility-skew", "velocity-differentiated")

    def not_applicable(self, dataset: Dataset) -> str:
        """A wave of a clock of its own has its frequency fitted in every trial."""
        fitted = all(trial.wave is not None and trial.wave.free for trial in dataset.trials)
        return "the frequency of every trial's wave is fitted already" if fitted else ""

    def clock(self, time: FloatArray, values: Values) -> FloatArray:
        """Return (1 + e) t."""
        return time * (1.0 + values["error"])

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Return velocities by the camera's clock."""
        del trial
        read = state.copy()
        read[:, :3] *= 1.0 + values["error"]
        return read
