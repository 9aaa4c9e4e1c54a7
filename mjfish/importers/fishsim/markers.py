"""Marker files of srl-ethz/fishsim: their layout on the robot, reading, pixels to metres."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.errors import InputError

#: Frames a second of the videos [Hz].
RATE = 60.0
#: Stations of the nine markers from the nose of `eth_tendon`, along the straight fish [m].
STATIONS = readonly(0.08 + np.array([-0.077, 0.065, 0.28, 0.2995, 0.3295, 0.3615, 0.3905, 0.4115, 0.474]))
#: Rigid with the head: two on its plates, one on the fin of the body, in front of the first hinge.
HEAD = (0, 1, 2)
#: Tail plates and tail fin.
TAIL = (3, 4, 5, 6, 7, 8)
#: Link after the head that each tail marker sits on; the fin's link carries two.
TAIL_LINK = (1, 2, 3, 4, 5, 5)

_COLUMNS = 2 * len(STATIONS)
#: A second: less cannot hold a beat of this robot.
_FEWEST = 60


@dataclass(frozen=True, eq=False)
class MarkerFile:
    """One file, in metres, seen from above: x to the right of the image, y up the image, z towards the camera.

    Attributes:
        path: the file.
        position: (n, 9, 2) as tracked, right or wrong [m].
        scale: metres a pixel.
    """

    path: Path
    position: FloatArray
    scale: float

    @property
    def name(self) -> str:
        """Name of the run, e.g. ``f1_00`` of ``markers_f1_00.csv``."""
        return self.path.stem.removeprefix("markers_")


def read(path: Path) -> MarkerFile:
    """Read a marker file: no header, 18 columns X0, Y0, ..., X8, Y8 in pixels, image y down, one row a frame.

    The scale comes from markers 0 and 1, whose distance is known; the median over all frames is not moved by frames
    in which one of them is lost.

    Raises:
        InputError: no such file, no text, another number of columns, text or NaN in a cell, less than a second.
    """
    pixel = _pixels(path)
    apart = float(np.median(np.hypot(*(pixel[:, 1] - pixel[:, 0]).T)))
    if apart <= 0.0:
        raise InputError(f"{path}: markers 0 and 1 lie on each other, which leaves no scale; track them again")
    scale = float(STATIONS[1] - STATIONS[0]) / apart
    # The mirror turns the image's left-handed pair (x right, y down) into a right-handed one with z up.
    return MarkerFile(path=path, position=readonly(pixel * [scale, -scale]), scale=scale)


def _pixels(path: Path) -> FloatArray:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text: {error}; give a marker file of fishsim") from None
    rows = [_row(path, number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    if len(rows) < _FEWEST:
        raise InputError(
            f"{path}: has {len(rows)} rows, expected one a frame at {RATE:g} frames a second and {_FEWEST} or more; "
            "give a longer track"
        )
    return np.array(rows).reshape(len(rows), -1, 2)


def _row(path: Path, number: int, line: str) -> list[float]:
    cells = line.split(",")
    if len(cells) != _COLUMNS:
        raise InputError(
            f"{path}: row {number}: {len(cells)} columns, expected {_COLUMNS} (X0, Y0 to X8, Y8 in pixels, separated "
            "by commas); give a marker file of fishsim as it is in Data/Markers, not a rotated one"
        )
    return [_number(path, number, column, cell) for column, cell in enumerate(cells, start=1)]


def _number(path: Path, row: int, column: int, cell: str) -> float:
    axis = "XY"[(column - 1) % 2]
    where = f"{path}: row {row}, column {column} ({axis}{(column - 1) // 2})"
    try:
        value = float(cell)
    except ValueError:
        raise InputError(
            f"{where}: '{cell.strip()}' is not a number, expected a pixel; correct the cell (the files have no header)"
        ) from None
    if not np.isfinite(value):
        raise InputError(f"{where}: {value}, expected a finite pixel; correct the cell or cut the track there")
    return value
