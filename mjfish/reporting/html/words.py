"""Numbers and verdicts as a reader wants them."""

from __future__ import annotations

import math

from mjfish.diagnosis import Estimate
from mjfish.diagnosis.result import Verdict

#: Badge of each verdict.
VERDICTS: dict[Verdict, str] = {
    "named": "Cause named",
    "nothing_wrong": "Nothing wrong",
    "cannot_tell": "Cannot tell",
    "unexplained": "Unexplained",
}
CHANNEL_NAMES = {"surge": "surge", "sway": "sway", "yaw_rate": "yaw rate"}
_MINUS = "\N{MINUS SIGN}"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits; very small and very large ones as powers of ten."""
    if not math.isfinite(value):
        return "–"
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPT)}".replace("-", _MINUS)
    places = digits - 1 - math.floor(math.log10(abs(value))) if value != 0.0 else 0
    return f"{value:.{max(places, 0)}f}".replace("-", _MINUS)


def percent(share: float, digits: int = 3) -> str:
    """Return a share as a percentage."""
    return f"{number(100.0 * share, digits)}\N{NO-BREAK SPACE}%"


def chance(p: float) -> str:
    """Return a p value; those below one in ten thousand are not told apart."""
    return "< 0.0001" if p < 1e-4 else number(p, 2)


def unit(symbol: str) -> str:
    """Return a unit to be written behind a number: nothing for a dimensionless one."""
    return "" if symbol == "-" else symbol


def estimate(one: Estimate) -> str:
    """Return an estimate to the places its interval deserves (two digits of its half width); a bound as it is."""
    return f"{one.estimate:g}" if one.at_bound else _rounded(one.estimate, one)


def interval(one: Estimate) -> str:
    """Return the 95 % interval to the same places as the estimate; empty where it has no width."""
    if not one.high > one.low:
        return ""
    return f"{_rounded(one.low, one)} to {_rounded(one.high, one)}"


def _rounded(value: float, one: Estimate) -> str:
    half = 0.5 * (one.high - one.low)
    if not (math.isfinite(half) and half > 0.0) or not 1e-4 <= max(abs(one.low), abs(one.high)) < 1e6:
        return number(value)
    places = min(max(1 - math.floor(math.log10(half)), 0), 9)
    return f"{value:.{places}f}".replace("-", _MINUS)
