"""What the study found, as plain data too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.estimation import Part
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray
from studies.table_iv.misfit import Fitted, rms
from studies.table_iv.ranges import Ranges, rounding, scatter
from studies.table_iv.reasons import UNIT, Reason

#: A range that is off by more than this is said not to be reproduced, log(simulated / published).
OFF = 0.1
_PARTS: tuple[Part, ...] = ("start_up", "change", "steady")


@dataclass(frozen=True, eq=False)
class Account:
    """What one reason accounts for.

    Attributes:
        reason: it.
        alone: fitted with all else as it is, the coefficients at lambda*.
        beside: fitted with the coefficients.
        with_unit: fitted with the coefficients and the unit of beta psi; None where it is the unit.
    """

    reason: Reason
    alone: Fitted
    beside: Fitted
    with_unit: Fitted | None

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        names = {p.name for p in self.reason.parameters}
        fits = {"alone": self.alone, "with_coefficients": self.beside, "with_coefficients_and_unit": self.with_unit}
        return {
            "reason": self.reason.name,
            "about": self.reason.about,
            **{key: None if fit is None else _outcome(fit, names) for key, fit in fits.items()},
        }


@dataclass(frozen=True)
class Held:
    """The coefficients fitted with the unit of beta psi held.

    Attributes:
        unit: [deg].
        misfit: what they leave.
        speed: steady speed in the first of the modes [m/s].
    """

    unit: float
    misfit: float
    speed: float


@dataclass(frozen=True, eq=False)
class Fits:
    """All that was fitted.

    Attributes:
        coefficients: the nine alone.
        fitted: with the unit of beta psi.
        ranges: of every mode, simulated with the latter.
        scaled: lambda* with the unit of beta psi alone.
        scaled_ranges: of every mode, simulated with these.
        accounts: of the reasons.
        held: the coefficients fitted with the unit held.
    """

    coefficients: Fitted
    fitted: Fitted
    ranges: tuple[Ranges, ...]
    scaled: Fitted
    scaled_ranges: tuple[Ranges, ...]
    accounts: tuple[Account, ...]
    held: tuple[Held, ...]

    @property
    def ranked(self) -> tuple[Account, ...]:
        """The reasons by the misfit that is left where they are fitted with the coefficients."""
        return tuple(sorted(self.accounts, key=lambda one: one.beside.misfit))


@dataclass(frozen=True, eq=False)
class PaperComparison:
    """Simulated and published ranges of the modes of Table IV.

    Attributes:
        fish: its name.
        unit: of beta psi in the fish [deg].
        modes: names.
        published: (modes, 3) surge, sway [m/s], yaw rate [rad/s].
        nominal: with the fish's own coefficients, lambda*.
        nominal_ranges: of every mode, with these.
        fits: None where nothing was fitted.
    """

    fish: str
    unit: float
    modes: tuple[str, ...]
    published: FloatArray
    nominal: Fitted
    nominal_ranges: tuple[Ranges, ...]
    fits: Fits | None

    @property
    def fitted_unit(self) -> float:
        """Unit of beta psi [deg] fitted with the coefficients; that of the fish where nothing was fitted."""
        return self.unit if self.fits is None else self.unit_of(self.fits.fitted)

    def unit_of(self, fitted: Fitted) -> float:
        """Return the unit of beta psi [deg] in a fit that has it free."""
        return self.unit * (1.0 + fitted.values[UNIT.parameters[0].name])

    @property
    def scatter(self) -> FloatArray:
        """By how much published ranges of like runs differ (3,), see `studies.table_iv.ranges.scatter`."""
        return scatter(self.published, self.nominal_ranges if self.fits is None else self.fits.ranges)

    @property
    def not_reproduced(self) -> tuple[tuple[str, str, float], ...]:
        """Mode, channel and simulated / published of what is off by more than `OFF`, worst first."""
        residuals = self.nominal.residuals if self.fits is None else self.fits.fitted.residuals
        order = np.argsort(-np.abs(residuals), axis=None, kind="stable")
        found = [(int(k) // len(CHANNELS), int(k) % len(CHANNELS)) for k in order]
        return tuple((self.modes[i], CHANNELS[c], float(np.exp(residuals[i, c]))) for i, c in found
                     if abs(residuals[i, c]) > OFF)  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        found: dict[str, Any] = {
            "schema": 1,
            "fish": self.fish,
            "unit [deg]": self.unit,
            "rounding": rounding(self.modes),
            "scatter": dict(zip(CHANNELS, map(float, self.scatter), strict=True)),
            "nominal": _outcome(self.nominal, set()),
            "speed [m/s]": {nominal_range.mode: nominal_range.speed for nominal_range in self.nominal_ranges},
            "ranges": self.rows(),
        }
        if self.fits is not None:
            found |= {
                "nominal_with_unit": {
                    "unit [deg]": self.unit_of(self.fits.scaled),
                    "speed [m/s]": {scaled_range.mode: scaled_range.speed for scaled_range in self.fits.scaled_ranges},
                    **_outcome(self.fits.scaled, set()),
                },
                "coefficients": _outcome(self.fits.coefficients),
                "fitted": {
                    "unit [deg]": self.fitted_unit,
                    "speed [m/s]": {range_.mode: range_.speed for range_ in self.fits.ranges},
                    **_outcome(self.fits.fitted),
                },
                "unit_held": [
                    {"unit [deg]": one.unit, "misfit": one.misfit, "speed [m/s]": one.speed} for one in self.fits.held
                ],
                "reasons": [account.to_dict() for account in self.fits.accounts],
            }
        return found

    def rows(self) -> list[dict[str, Any]]:
        """Return a row a mode and channel."""
        rows = []
        for i, mode in enumerate(self.modes):
            for c, channel in enumerate(CHANNELS):
                row = {"mode": mode, "channel": channel, "unit": UNITS[channel], "published": self.published[i, c]}
                row |= _cells("nominal", self.nominal_ranges[i], c)
                if self.fits is not None:
                    row |= _cells("nominal_with_unit", self.fits.scaled_ranges[i], c)
                    row |= _cells("fitted", self.fits.ranges[i], c)
                rows.append({key: float(v) if isinstance(v, np.floating) else v for key, v in row.items()})
        return rows


def by_channel(residuals: FloatArray) -> tuple[float, ...]:
    """Return the misfit of each channel (3,)."""
    return tuple(rms(residuals[:, channel]) for channel in range(len(CHANNELS)))


def _cells(prefix: str, ranges: Ranges, channel: int) -> dict[str, Any]:
    cells: dict[str, Any] = {prefix: ranges.whole[channel]}
    for part in _PARTS:
        cells[f"{prefix}_{part}"] = ranges.parts[part][channel] if part in ranges.parts else None
    return cells | {f"{prefix}_reached [s]": ranges.reached[channel]}


def _outcome(fitted: Fitted, only: set[str] | None = None) -> dict[str, Any]:
    """Return misfit and values as plain data; with `only` names, without the coefficients and others."""
    return {
        "misfit": fitted.misfit,
        "misfit_of": dict(zip(CHANNELS, by_channel(fitted.residuals), strict=True)),
        "at_bounds": list(fitted.at_bounds),
        "values": {name: value for name, value in fitted.values.items() if only is None or name in only},
    }
