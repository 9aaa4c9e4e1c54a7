"""Where coefficients come from: the record that an identified fish carries, and whether a run leaves its range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import version

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.trial import for_looking
from mjfish.data.validation import SAME, beats
from mjfish.fish import Cpg, Fish
from mjfish.fish.fish import Identified, Span
from mjfish.model.model import requested_motion

_UNITS: dict[str, str] = {"speed": "m/s", "beat": "Hz", "amplitude": "rad"}


def covered(trials: Iterable[Trial], cpg: Cpg | None) -> dict[str, Span]:
    """Return the range of some runs, see `Identified.range`; places and headings are differentiated for the speed."""
    found: dict[str, list[float]] = {name: [] for name in _UNITS}
    for trial in map(for_looking, trials):
        if trial.measured[0]:
            quarters = [float(part.mean()) for part in np.array_split(trial.velocity[:, 0], 4) if len(part)]
            found["speed"] += [float(np.mean(quarters[len(quarters) // 2 :])), max(quarters)]
        for name, own in _of_drive(trial, cpg).items():
            found[name] += own
    return {name: (min(own), max(own)) for name, own in found.items() if own}


def _of_drive(trial: Trial, cpg: Cpg | None) -> dict[str, list[float]]:
    """Return the beats and the amplitude of a run, which are known before it is swum."""
    return {
        "beat": beats(trial),
        "amplitude": [0.5 * float(np.ptp(requested_motion(cpg, trial, trial.step).angle, axis=(0, 1)).max())],
    }


def with_origin(fish: Fish, dataset: Dataset, outcome: str, intervals: Mapping[str, Span]) -> Fish:
    """Return a fish that says where its numbers come from.

    Args:
        fish: with its numbers.
        dataset: that they were fitted to.
        outcome: of the fit, in words.
        intervals: by full name; ends that are not finite are no interval.
    """
    return fish.model_copy(
        update={
            "identified": Identified(
                geometry=fish.geometry,
                dataset=dataset.name,
                by=f"mjfish {version('mjfish')}",
                outcome=outcome,
                range=covered(dataset.split()[0], fish.cpg),
                intervals={name: ends for name, ends in intervals.items() if np.isfinite(ends).all()},
            )
        }
    )


def outside(fish: Fish, trial: Trial) -> str:
    """Return where a drive leaves the range that the coefficients of a fish were fitted in; empty where it does not.

    Numbers count as the same to a twentieth of the larger end. The speed follows from the drive, and is not compared.
    """
    known = {} if fish.identified is None else fish.identified.range
    left = [
        f"{name} {min(own):.2g} to {max(own):.2g} {_UNITS[name]}, fitted {low:.2g} to {high:.2g} {_UNITS[name]}"
        for name, own in (_of_drive(trial, fish.cpg) if known else {}).items()
        for low, high in ([known[name]] if own and name in known else [])
        if max(low - min(own), max(own) - high) > SAME * max(abs(low), abs(high))
    ]
    return f"{fish.name}: its coefficients were not fitted to such drives: {'; '.join(left)}" if left else ""
