"""The runs, how they are divided, what of a diagnosis the page tells."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from importers import tail_fish
from importers.tail_fish import Study
from mjfish.data import Dataset
from mjfish.diagnosis import Diagnosis
from mjfish.errors import InputError
from mjfish.files import tomlfile
from mjfish.files.plain_data import plain as plain_of
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
from studies.licence import check_mit

VARIABLE = "MJFISH_TAILFISH"


def files() -> list[Path]:
    """Return the files of the runs, sorted.

    Raises:
        InputError: nobody says where they are; how they are got is said. Their licence is no longer MIT.
    """
    named = os.environ.get(VARIABLE)
    found = sorted(Path(named).glob("Amp*Bias*.txt")) if named else []
    if len(found) < len(CHANNELS):
        raise InputError(
            f"{VARIABLE} must name the folder of the measured files, which are public: Koopman_RoboticFish/AllData.zip "
            "of https://github.com/giorgosmamakoukas/DerivativeBasedKoopman, each named after its folder, such as "
            "Amp20Bias-30.txt"
        )
    check_mit(found[0].parent)
    return found


def settings() -> Study:
    """Return what the robot's file of settings says of the study."""
    return tomlfile.read(tail_fish.SETTINGS, tail_fish.Settings).study


def held_out(recorded: Sequence[Path], study: Study) -> list[str]:
    """Return the names of the runs that are held out."""
    return [path.stem for path in recorded if fnmatchcase(path.stem, study.held_out)]


def divided(recorded: Sequence[Path], study: Study) -> Dataset:
    """Return the dataset of the runs.

    Raises:
        InputError: all runs would be fitted, or all held out; a file is of another robot.
    """
    held = held_out(recorded, study)
    if not 0 < len(held) < len(recorded):
        raise InputError(
            f"{recorded[0].parent}: {len(held)} of {len(recorded)} files are {study.called}, expected some of "
            "them and some others; get the files of all amplitudes"
        )
    dataset, _ = tail_fish.import_files(recorded, held)
    return dataset


def wander(time: FloatArray, measured: FloatArray, predicted: FloatArray, frequency: float) -> float:
    """Return the standard deviation [rad] of the phase of a signal (n,) beat by beat against a prediction of it."""
    phases = []
    for begin in np.arange(time[0], time[-1] - 1.0 / frequency, 1.0 / frequency):
        beat = (time >= begin) & (time < begin + 1.0 / frequency)
        turning = np.exp(-2j * np.pi * frequency * time[beat])
        phases.append(np.angle(np.sum(measured[beat] * turning) / np.sum(predicted[beat] * turning)))
    return float(np.std(phases))


def told(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return what the page tells of a diagnosis, as plain data."""
    plain = diagnosis.to_dict()
    yaw = CHANNELS.index("yaw_rate")
    spreads = []
    for overlay in diagnosis.overlays:
        wave = overlay.trial.wave
        if overlay.held_out and wave is not None and np.all(np.isfinite(overlay.nominal)):
            rates = overlay.trial.velocity[:, yaw], overlay.nominal[:, yaw]
            spreads.append(wander(overlay.trial.time, *rates, wave.frequency))
    kept = ("verdict", "message", "mechanisms", "domain", "remarks", "coefficients")
    return {
        **{key: plain[key] for key in kept},
        "by_run": plain["gain"]["by_run"] if plain["gain"] else [],
        "findings": [finding["message"] for finding in plain["checks"]["findings"]],
        "wander": spreads,
        "walk": [{"gain": row.gain, **plain_of(row.sizes)} for row in diagnosis.table.random],
    }


def means(by_run: Sequence[Mapping[str, Any]], model: str) -> tuple[float, ...]:
    """Return the mean over runs of nRMSE of surge, sway, yaw rate, and of the error of the mean speed [m/s]."""
    errors = [[*(run[model][channel] for channel in CHANNELS), run["mean_speed_error"][model]] for run in by_run]
    return tuple(float(value) for value in np.mean(errors, axis=0))
