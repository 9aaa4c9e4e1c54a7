"""The curves of named mechanisms as CSV files, one a curve."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from mjfish.data import write_table
from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.errors import InputError
from mjfish.files.writing import check_file, make_folder
from mjfish.numerics.arrays import FloatArray


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
