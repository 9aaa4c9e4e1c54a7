"""Recordings of a laboratory: a camera over simulated runs, with headers, units and axes of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjfish.data import Sensor, Trial
from mjfish.drive.wave import Wave, joint_motion
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

#: Frequency [Hz] and bias of all joints [rad] of each run, and where it begins: x, y [m], heading [rad].
RUNS = {
    "run1": (1.0, 0.0, (0.42, -0.9, 0.6)),
    "run2": (1.6, 0.0, (0.5, -0.4, -1.2)),
    "run3": (2.0, 0.0, (1.5, -1.1, 2.9)),
    "run4": (1.3, 0.1, (0.8, -0.7, -2.2)),
    "run5": (1.5, -0.1, (1.1, -0.6, 1.5)),
}
AMPLITUDE, PHASE = (8.0, 14.0, 20.0), (0.0, -60.0, -120.0)
RATE = 30.0
HEADER = "Frame,Time [s],Head_X [mm],Head_Y [mm],Heading [deg],cmd_1 [deg],cmd_2 [deg],cmd_3 [deg]"


def write_recordings(
    folder: Path,
    fish: Path,
    cause: str | None = None,
    values: Mapping[str, float] | None = None,
    *,
    noise: tuple[float, float] = (0.001, 0.0087),
    seed: int = 4,
) -> list[Path]:
    """Write a CSV a run: places in mm in an image with y down, headings and commanded angles in deg; return the files.

    Args:
        folder: to write to.
        fish: TOML of a fish with three joints.
        cause: an effect that acts, with `values` by full name; None: the nominal model.
        values: see above; other coefficients by default.
        noise: sigma of places [m] and headings [rad].
        seed: of the noise.
    """
    model = Model(load_fish(str(fish)), () if cause is None else (find(cause),))
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 7.0, 1.0 / RATE)
    sensors = tuple(
        Sensor(kind, kind, time, np.zeros((len(time), width)), station=0.02 if kind == "position" else 0.0)
        for kind, width in (("position", 2), ("heading", 1))
    )  # type: ignore[arg-type]
    files = []
    for name, (frequency, bias, place) in RUNS.items():
        wave = Wave(frequency, tuple(np.radians(AMPLITUDE)), tuple(np.radians(PHASE)), (bias,) * 3, ramp=1.0)
        still = readonly(np.zeros((len(time), 3)))
        blank = Trial(name, None, readonly(time), still, wave=wave, sensors=sensors)
        read = model.predict(blank, model.values(values), pose=np.array(place)).sensors
        seen, heading = (block + rng.normal(0.0, own, block.shape) for block, own in zip(read, noise, strict=True))
        clockwise = (180.0 - np.degrees(heading[:, 0])) % 360.0 - 180.0
        told = np.degrees(joint_motion(wave, 0.0, float(time[-1]), 0.005).angle_at(time))
        columns = [np.arange(len(time)), time, 1e3 * seen * [1.0, -1.0], clockwise, told]
        path = folder / f"{name}.csv"
        formats = ["%d", "%.3f", "%.1f", "%.1f", *["%.2f"] * 4]
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=HEADER, comments="", fmt=formats)
        files.append(path)
    return files
