"""A small valid dataset as text, edits that break it, and the equality of datasets to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trial
from mjfish.data import Dataset, Trial
from mjfish.errors import InputError

Edit = Callable[[str], str]

TOML = """\
schema = 1
name = "pool"
fish = "pike"
clock = "synchronised"

[noise]
surge = 0.01
sway = 0.01
yaw_rate = 0.05

[start]
c_d.head = 1.5

[[trials]]
name = "cpg"
file = "cpg.csv"
role = "fit"

[[trials.drive]]
start = 0.0
omega = 18.0
bias = [0, 0, 0, 0]

[[trials.drive]]
start = 0.5
omega = 22.0
bias = [0, 1, 1.5, 2]

[[trials]]
name = "measured"
file = "measured.csv"
role = "held_out"
"""

STEP = 0.02
ROWS = 51


def _csv(columns: dict[str, np.ndarray]) -> str:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def _velocities() -> dict[str, np.ndarray]:
    time = np.round(np.arange(ROWS) * STEP, 6)
    wave = np.sin(18.0 * time)
    return {"time [s]": time, "surge [m/s]": 0.2 * time, "sway [m/s]": 0.1 * wave, "yaw_rate [rad/s]": 0.5 * wave}


def cpg_csv() -> str:
    """Velocities alone: the joints follow the CPG."""
    return _csv(_velocities())


def measured_csv(omega: float = 18.0) -> str:
    """Velocities and four joint angles that beat at `omega`."""
    columns = _velocities()
    for joint in range(4):
        columns[f"joint_{joint + 1} [rad]"] = 0.4 * np.cos(omega * columns["time [s]"] - joint)
    return _csv(columns)


def write_folder(folder: Path, *, toml: str = TOML, cpg: str | None = None, measured: str | None = None) -> Path:
    """Write the dataset with the given texts in place of the valid ones."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dataset.toml").write_text(toml, encoding="utf-8")
    (folder / "cpg.csv").write_text(cpg_csv() if cpg is None else cpg, encoding="utf-8", newline="")
    (folder / "measured.csv").write_text(measured_csv() if measured is None else measured, encoding="utf-8", newline="")
    return folder


def swap(old: str, new: str) -> Edit:
    """Replace the first `old`, which must be there."""

    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return edit


def cell(row: int, column: int, value: str) -> Edit:
    """Replace the cell in data row `row` (from 1; 0 is the header), column `column` (from 0)."""

    def edit(text: str) -> str:
        lines = text.splitlines()
        cells = lines[row].split(",")
        cells[column] = value
        lines[row] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return edit


def lines(change: Callable[[list[str]], list[str]]) -> Edit:
    """Change the list of lines; line 0 is the header, line k data row k."""
    return lambda text: "\n".join(change(text.splitlines())) + "\n"


def without_column(column: int) -> Edit:
    """Remove a column (from 0)."""
    return lines(lambda all_: [",".join(x for i, x in enumerate(line.split(",")) if i != column) for line in all_])


def with_column(header: str, value: str = "0.0") -> Edit:
    """Append a constant column."""
    return lines(lambda all_: [f"{all_[0]},{header}", *(f"{line},{value}" for line in all_[1:])])


def _bits(array: np.ndarray | None) -> object:
    return None if array is None else (array.shape, array.dtype.str, np.ascontiguousarray(array).tobytes())


def _content(trial: Trial) -> tuple[object, ...]:
    arrays = (trial.time, trial.velocity, trial.joint_angle, trial.pose, trial.roll)
    return (trial.name, trial.role, trial.drive, *map(_bits, arrays))


def same(a: Dataset, b: Dataset) -> bool:
    """Whether two datasets are equal to the last bit, wherever they were read from."""
    return (a.name, a.fish, a.clock, _bits(a.noise), [_content(trial) for trial in a.trials]) == (
        b.name,
        b.fish,
        b.clock,
        _bits(b.noise),
        [_content(trial) for trial in b.trials],
    )


def refusal(folder: Path) -> str:
    """Return why a dataset is refused."""
    with pytest.raises(InputError) as caught:
        trial.load_dataset(folder)
    return str(caught.value)
