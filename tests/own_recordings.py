"""Recordings of a laboratory: simulated runs with headers of its own, in millimetres and degrees."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjfish.arrays import readonly
from mjfish.data import Trial
from mjfish.drive.wave import Wave, joint_motion
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.model import Model

#: Frequency [Hz] and bias of all joints [rad] of each run.
RUNS = {"run1": (1.2, 0.0), "run2": (1.6, 0.0), "run3": (2.0, 0.0), "run4": (1.4, 0.15)}
AMPLITUDE, PHASE = (14.0, 22.0), (0.0, -70.0)
RATE = 100.0


def write_recordings(
    folder: Path,
    fish: Path,
    cause: str | None = None,
    values: Mapping[str, float] | None = None,
    *,
    header: str = "t_ms,u_mm_s,v_mm_s,yaw_rate_deg_s,servo1_deg,servo2_deg",
    noise: tuple[float, float, float] = (0.004, 0.004, 0.02),
    seed: int = 4,
) -> list[Path]:
    """Write a CSV a run: ms, mm/s, deg/s, deg; return the files.

    Args:
        folder: to write to.
        fish: TOML of a fish with two joints.
        cause: an effect that acts, with `values` by full name; None: the nominal model.
        values: see above; other coefficients by default.
        header: names of time, surge, sway, yaw rate and the joints.
        noise: sigma of the velocities, SI.
        seed: of the noise.
    """
    body = load_fish(str(fish))
    model = Model(body, () if cause is None else (find(cause),))
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 8.0, 1.0 / RATE)
    files = []
    for name, (frequency, bias) in RUNS.items():
        wave = Wave(frequency, tuple(np.radians(AMPLITUDE)), tuple(np.radians(PHASE)), (bias, bias), ramp=1.0)
        blank = Trial(name, None, readonly(time), readonly(np.zeros((len(time), 3))), wave=wave)
        velocity = model.predict(blank, model.values(values)).velocity + rng.normal(0.0, noise, (len(time), 3))
        motion = joint_motion(wave, 0.0, float(time[-1]), 1.0 / RATE).angle
        angles = np.concatenate([motion[:, 0], motion[-1:, 2]])
        columns = [1e3 * time, 1e3 * velocity[:, :2], np.degrees(velocity[:, 2]), np.degrees(angles)]
        path = folder / f"{name}.csv"
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.4f")
        files.append(path)
    return files
