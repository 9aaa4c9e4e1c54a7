"""What the study says, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mjfish.drive import modes
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
from studies.table_iv.misfit import rms
from studies.table_iv.ranges import rounding
from studies.table_iv.result import OFF, Account, Fits, PaperComparison, by_channel

#: A unit with which the coefficients leave at most this many times the smallest misfit fits as well.
_AS_WELL = 1.2


def sentences(found: PaperComparison) -> Iterator[str]:
    """Yield what the study says, a sentence or two a line."""
    ratio = float(np.exp(np.mean(found.nominal.residuals)))
    yield (
        f"lambda* at {found.unit:.4g} deg a unit of beta psi: the ranges are {ratio:.2f} times the published ones; "
        f"misfit (rms of log ratios) {_split(found.nominal.misfit, found.nominal.residuals)}; {found.modes[0]} swims "
        f"at {found.nominal_ranges[0].speed:.2f} m/s."
    )
    if found.fits is not None:
        yield from _fitted(found, found.fits)
        yield from _ranked(found.fits)
    yield from _left(found)


def _fitted(found: PaperComparison, fits: Fits) -> Iterator[str]:
    scaled, first = fits.scaled, fits.scaled_ranges[0]
    yield (
        f"lambda* and a unit of {found.unit_of(scaled):.4f} deg, the only number fitted: misfit "
        f"{_split(scaled.misfit, scaled.residuals)}; {first.mode} swims at {first.speed:.2f} m/s."
    )
    at = len(fits.coefficients.at_bounds)
    yield (
        f"Coefficients fitted within the bounds of Table III: misfit {fits.coefficients.misfit:.3f}, "
        f"{at} of {len(fits.coefficients.free)} at a bound."
    )
    at = len(fits.fitted.at_bounds)
    yield (
        f"Coefficients and unit fitted: misfit {_split(fits.fitted.misfit, fits.fitted.residuals)} at "
        f"{found.fitted_unit:.4f} deg, {at} of {len(fits.fitted.free)} at a bound."
    )
    least = min(one.misfit for one in fits.held)
    alike = [one.unit for one in fits.held if one.misfit <= _AS_WELL * least]
    others = ", ".join(f"{one.unit:g} deg {one.misfit:.3f} ({one.speed:.2f} m/s)" for one in fits.held)
    yield (
        f"Misfit with the unit held, and steady speed of {found.modes[0]}: {others}. Units from {min(alike):g} to "
        f"{max(alike):g} deg fit about as well: ranges do not tell unit and coefficients apart."
    )


def _ranked(fits: Fits) -> Iterator[str]:
    best, *rest = fits.ranked
    yield (
        f"Most likely reason: {best.reason.about}; with the coefficients it takes the misfit from "
        f"{fits.coefficients.misfit:.3f} to {best.beside.misfit:.3f} ({_gain(best, fits)}). Next: "
        + "; ".join(f"{one.reason.name} {one.beside.misfit:.3f} ({_gain(one, fits)})" for one in rest)
        + "."
    )
    alone = sorted(fits.accounts, key=lambda one: one.alone.misfit)[:3]
    told = ", ".join(f"{one.reason.name} {one.alone.misfit:.3f}" for one in alone)
    yield f"With lambda* held, least is left by {told}."


def _gain(account: Account, fits: Fits) -> str:
    return f"{removed(account.beside.misfit, fits.coefficients.misfit):.0%} less".replace("-0%", "0%")


def removed(misfit: float, before: float) -> float:
    """Return the share of a misfit that is removed."""
    return 1.0 - misfit / before if before > 0.0 else 0.0


def _left(found: PaperComparison) -> Iterator[str]:
    own = found.scatter[np.isfinite(found.scatter)]
    if len(own):
        told = [
            f"{channel} {one:.3f}" for channel, one in zip(CHANNELS, found.scatter, strict=True) if np.isfinite(one)
        ]
        yield (
            f"Scatter of the experiment: published ranges of runs that begin alike differ by {rms(own):.3f} "
            f"({', '.join(told)}; rms of logs about their mean), their rounding is {rounding(found.modes):.3f}: a "
            "model that swims the same from the same start cannot fit them better."
        )
    shown = found.nominal_ranges if found.fits is None else found.fits.ranges
    early = sum(int(np.count_nonzero(one.reached <= one.settled)) for one in shown)
    yield (
        f"{early} of {found.published.size} simulated ranges are reached in the start-up, its first ten beats: they "
        "say little of steady swimming."
    )
    off = [f"{mode} {channel} {100.0 * (ratio - 1.0):+.0f} %" for mode, channel, ratio in found.not_reproduced]
    if found.fits is not None:
        yield f"Not reproduced, off by more than {100.0 * OFF:.0f} %: {', '.join(off) or 'none'}."
    if growth := _growth(found):
        yield growth


def _growth(found: PaperComparison) -> str:
    """Say how ranges grow with omega, in straight swimming at constant omega."""
    names = [name for name in ("v1", "v3", "v5", "v7") if name in found.modes]
    if len(names) < 2:
        return ""
    rows = [found.modes.index(name) for name in names]
    omega = np.log([modes.drive(name)[0].omega for name in names])
    simulated = found.nominal_ranges if found.fits is None else found.fits.ranges
    tables = {"published": found.published[rows], "simulated": np.array([simulated[row].whole for row in rows])}
    told = [f"{name} {_exponents(omega, table)}" for name, table in tables.items()]
    return f"Growth from {names[0]} to {names[-1]} as omega to the power ({', '.join(CHANNELS)}): {'; '.join(told)}."


def _exponents(omega: FloatArray, ranges: FloatArray) -> str:
    return ", ".join(f"{slope:.2f}" for slope in np.polyfit(omega, np.log(ranges), 1)[0])


def _split(misfit: float, residuals: FloatArray) -> str:
    parts = ", ".join(f"{channel} {one:.3f}" for channel, one in zip(CHANNELS, by_channel(residuals), strict=True))
    return f"{misfit:.3f} ({parts})"
