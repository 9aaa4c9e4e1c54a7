"""Reasons why simulated ranges may not be the published ones, each with the numbers that stand for it."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.effects import Effect, catalogue
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.parameters import Parameter
from studies.table_iv.causes import FinHeight, HeadInertia, PsiUnit, SoftStart
from studies.table_iv.ranges import smallest_rmse


@dataclass(frozen=True)
class Reason:
    """One reason.

    Attributes:
        name: short.
        about: one line.
        effects: that stand for it.
        noise: sigma of the measurement, one a channel; none where the reason is another.
    """

    name: str
    about: str
    effects: tuple[Effect, ...] = ()
    noise: tuple[Parameter, ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its numbers."""
        return (*(p for effect in self.effects for p in effect.parameters), *self.noise)


def noise_parameters() -> tuple[Parameter, ...]:
    """Return sigma of white noise of each channel; none is above the smallest RMSE of Table IV."""
    return tuple(
        Parameter(f"noise.{channel}", UNITS[channel], 0.0, 0.0, float(most), 0.0, 0.1 * float(most), about="sigma")
        for channel, most in zip(CHANNELS, smallest_rmse(), strict=True)
    )


#: The coefficients alone: what every other reason is added to.
COEFFICIENTS = Reason("coefficients", "the nine coefficients, within the bounds of Table III")
UNIT = Reason("unit", "the unit of beta psi, not printed", (PsiUnit(),))


def reasons() -> tuple[Reason, ...]:
    """Return all reasons, the unit of beta psi first."""
    known = catalogue()
    return (
        UNIT,
        Reason("heights", "heights of all sections, and of the caudal fin", (known["section_height"], FinHeight())),
        Reason("head_inertia", "I_0, at most that of two point masses", (HeadInertia(),)),
        Reason("roll", "the marker swings with the roll", (known["roll"],)),
        Reason("noise", "ranges of noisy records are larger", (), noise_parameters()),
        Reason("soft_start", "the beat grows more slowly at the start", (SoftStart(),)),
        Reason("servo_lag", "the servos lag", (known["servo_lag"],)),
        Reason("reynolds", "coefficients are larger at low speed", (known["reynolds_drag"],)),
    )
