"""How numbers and channels are written for people: in messages, in the terminal, on pages and in logs."""

from __future__ import annotations

import math

#: Stands for a number that is not known.
NONE = "–"
#: How channels, and groups of them, read.
CHANNEL_NAMES = {
    "surge": "surge",
    "sway": "sway",
    "yaw_rate": "yaw rate",
    "pooled": "all channels",
    "mean_speed": "mean speed",
}
_MINUS = "\N{MINUS SIGN}"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits; very small and very large ones as powers of ten."""
    if value is None or not math.isfinite(value):
        return NONE
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        return f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPT)}".replace("-", _MINUS)
    return fixed(value, digits - 1 - int(exponent) if value != 0.0 else 0)


def fixed(value: float, places: int) -> str:
    """Return a number with so many decimal places, none where that is negative."""
    return f"{value:.{max(places, 0)}f}".replace("-", _MINUS)


def percent(share: float | None, digits: int = 3) -> str:
    """Return a share as a percentage."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"{number(100.0 * share, digits)}\N{NO-BREAK SPACE}%"


def less(share: float) -> str:
    """Return by which share something falls; of a negative one, by how much it grows.

    >>> less(-0.016).replace("\N{NO-BREAK SPACE}", " ")
    '1.60 % more'
    """
    return f"{percent(abs(share))} {'more' if share < 0.0 else 'less'}"


def fall(before: float, after: float) -> str:
    """Return by which share something falls or grows that was there before."""
    return less(1.0 - after / before) if before > 0.0 else NONE


def p_value(p: float | None) -> str:
    """Return a p value; those below one in ten thousand are not told apart."""
    return "< 0.0001" if p is not None and p < 1e-4 else number(p, 2)


def unit(symbol: str) -> str:
    """Return a unit to be written behind a number: nothing for a dimensionless one."""
    return "" if symbol == "-" else symbol


def counted(count: int, what: str) -> str:
    """Return how many there are of something.

    >>> counted(1, "cause"), counted(2, "cause")
    ('1 cause', '2 causes')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def channel_name(channel: str) -> str:
    """Return a channel in words; those of sensors have names, such as ``position x``, that stay as they are."""
    return CHANNEL_NAMES.get(channel, channel)
