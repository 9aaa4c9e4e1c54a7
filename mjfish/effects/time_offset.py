"""Clock offset between camera and drive."""

from __future__ import annotations

from mjfish.data import Dataset
from mjfish.effects.calibration import SYNC_FLASH
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class TimeOffset(Effect):
    """What is recorded at t happened at t + offset: V_recorded(t) = V(t + offset).

    The camera's clock and the clock of the drive are set apart by a constant. Nothing in the water changes.
    """

    name, domain, mechanism = "time_offset", "data", "clock"
    summary = "the clocks of camera and drive are apart"
    parameters = (
        Parameter(
            "time_offset.offset", "s", 0.0, -0.25, 0.25, 0.0, 0.005, about="recorded at t, happened at t + offset"
        ),
    )
    source = "Data compatibility check, Jategaonkar, Flight Vehicle System Identification (2006), ch. 10"
    signature = "every channel is shifted by the same time; the phase error grows with frequency"
    confirm = "flash a light in the camera's view when the drive starts"
    fingerprint = Fingerprint(exponent=1.0, odd=False, part="everywhere")
    calibration = SYNC_FLASH
    resembles = (
        "clock-drift",
        "clock-jump",
        "compatibility-derived",
        "compatibility-skew",
        "design-no-start",
        "repeats-differ",
        "stuck-frozen",
        "velocity-differentiated",
    )

    def not_applicable(self, dataset: Dataset) -> str:
        """A free clock makes the offset a nuisance of every trial."""
        return "the clock offset of each trial is fitted already (clock = 'free')" if dataset.clock == "free" else ""

    def clock(self, time: FloatArray, values: Values) -> FloatArray:
        """Return t + offset."""
        return time + values["offset"]
