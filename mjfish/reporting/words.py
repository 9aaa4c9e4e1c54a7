"""Words and number formats that pages, logs and the terminal share."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjfish.diagnosis import Estimate
    from mjfish.diagnosis.forms import NamedMechanism

#: How the verdicts read.
VERDICTS = {
    "named": "Cause named",
    "nothing_wrong": "Nothing wrong",
    "cannot_tell": "Cannot tell",
    "unexplained": "Unexplained",
}
#: How channels, and groups of them, read.
CHANNEL_NAMES = {"surge": "surge", "sway": "sway", "yaw_rate": "yaw rate", "pooled": "all channels"}
#: How the quantities of curves read; others by their name.
QUANTITY_NAMES = {
    "c_d": "Drag coefficient across, c_d",
    "c_f": "Friction coefficient along, c_f",
    "c_n": "Coefficient of the force across the chord, c_n",
    "c_m": "Coefficient of the added mass, c_m",
    "joint_angle": "Angle that the joints reach",
    "moment": "Moment of the spring",
}
#: Stands for a number that is not known.
NONE = "–"
_MINUS = "\N{MINUS SIGN}"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits; very small and very large ones as powers of ten."""
    if value is None or not math.isfinite(value):
        return NONE
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPT)}".replace("-", _MINUS)
    places = digits - 1 - math.floor(math.log10(abs(value))) if value != 0.0 else 0
    return f"{value:.{max(places, 0)}f}".replace("-", _MINUS)


def percent(share: float | None, digits: int = 3) -> str:
    """Return a share as a percentage."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"{number(100.0 * share, digits)}\N{NO-BREAK SPACE}%"


def p_value(p: float | None) -> str:
    """Return a p value; those below one in ten thousand are not told apart."""
    return "< 0.0001" if p is not None and p < 1e-4 else number(p, 2)


def unit(symbol: str) -> str:
    """Return a unit to be written behind a number: nothing for a dimensionless one."""
    return "" if symbol == "-" else symbol


def estimate(value: Estimate) -> str:
    """Return an estimate to the places its interval deserves (two digits of its half width); a bound as it is."""
    return f"{value.estimate:g}" if value.at_bound else _rounded(value.estimate, value)


def interval(value: Estimate) -> str:
    """Return the 95 % interval to the same places as the estimate; empty where it has no width."""
    if not value.high > value.low:
        return ""
    return f"{_rounded(value.low, value)} to {_rounded(value.high, value)}"


def _rounded(number_: float, value: Estimate) -> str:
    half = 0.5 * (value.high - value.low)
    if not (math.isfinite(half) and half > 0.0) or not 1e-4 <= max(abs(value.low), abs(value.high)) < 1e6:
        return number(number_)
    places = min(max(1 - math.floor(math.log10(half)), 0), 9)
    return f"{number_:.{places}f}".replace("-", _MINUS)


def named_as(mechanism: NamedMechanism) -> str:
    """Say in a line how deep the data name a mechanism, and which forms of it stay."""
    if mechanism.level == "form":
        return f"{mechanism.name}: named with its form, {mechanism.form}"
    if mechanism.forms:
        return (
            f"{mechanism.name}: named as a mechanism; the data do not settle its form: {' or '.join(mechanism.forms)}"
        )
    return f"{mechanism.name}: named as a mechanism; no formula of it fits, its form is learned"


def channel_name(channel: str) -> str:
    """Return a channel in words; those of sensors have names, such as ``position x``, that stay as they are."""
    return CHANNEL_NAMES.get(channel, channel)
