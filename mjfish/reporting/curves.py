"""The curves of named mechanisms: how they are drawn, whatever draws them, and as CSV files, one a curve."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.data import write_table
from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.errors import InputError
from mjfish.files.writing import check_file, make_folder
from mjfish.numerics.arrays import FloatArray

#: Room above and below what is shown, as a share of it.
_MARGIN = 0.35


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of a curve.

    Attributes:
        x, y: (n,) of the curve.
        low, high: (n,) of its band.
        seen: whether the runs have been there.
    """

    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    seen: bool


def stretches(curve: MeasuredCurve) -> list[Stretch]:
    """Return the pieces below, inside and above the visited range; neighbours share an end."""
    x = np.array(curve.x.values)
    at = np.unique([*x, *(curve.seen or ())])
    y, low, high = (np.interp(at, x, values) for values in (curve.y.values, curve.y.low, curve.y.high))
    first, last = curve.seen or (np.inf, np.inf)
    pieces = ((at <= first, False), ((first <= at) & (at <= last), True), (at >= last, False))
    return [Stretch(at[own], y[own], low[own], high[own], seen) for own, seen in pieces if own.sum() > 1]


def span(curve: MeasuredCurve) -> tuple[float, float]:
    """Return the lowest and highest y to show: a band where no run has been may be too wide to be a scale."""
    shown = [stretch for stretch in stretches(curve) if stretch.seen] or stretches(curve)
    every = np.concatenate([curve.nominal, *(stretch.low for stretch in shown), *(stretch.high for stretch in shown)])
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    room = _MARGIN * (high - low) or max(abs(high), 1e-9)
    return low - room, high + room


def logarithmic(curve: MeasuredCurve) -> bool:
    """Return whether x stands on a logarithmic axis: the points of a curve that begins above zero are by ratios."""
    return curve.x.values[0] > 0.0


def write_curves(mechanisms: Iterable[NamedMechanism], folder: Path) -> tuple[Path, ...]:
    """Write every curve to a file ``MECHANISM-QUANTITY-GROUP.csv``, all of them or none.

    Args:
        mechanisms: whose curves are written.
        folder: made where it is not there, and not touched where there is no curve. Files of the same names are
            replaced, others stay.

    Returns:
        The files.

    Raises:
        InputError: a file cannot be written.
    """
    tables = {
        f"{mechanism.name}-{curve.quantity}-{curve.group}.csv": columns(curve)
        for mechanism in mechanisms
        for curve in mechanism.curves
    }
    if not tables:
        return ()
    make_folder(folder)
    for name in tables:
        check_file(folder / name)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".curves.", suffix=".partial") as partial:
            for name, table in tables.items():
                write_table(Path(partial) / name, table)
            for name in tables:
                (Path(partial) / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}; choose another folder") from None
    return tuple(folder / name for name in tables)


def columns(curve: MeasuredCurve) -> Mapping[str, FloatArray]:
    """Return the columns (n,) of a curve by header: x, y, its band, the nominal y, and 1 where the runs have been."""
    x, y = np.array(curve.x.values), curve.y
    low, high = curve.seen or (np.inf, -np.inf)
    return {
        f"{curve.x.name} [{curve.x.unit}]": x,
        f"{y.name} [{y.unit}]": np.array(y.values),
        f"{y.name}_low [{y.unit}]": np.array(y.low),
        f"{y.name}_high [{y.unit}]": np.array(y.high),
        f"nominal [{y.unit}]": np.array(curve.nominal),
        "visited [-]": ((low <= x) & (x <= high)).astype(np.float64),
    }
