"""Trials of a known truth without noise, whose dataset states a noise: what is measured on them is exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly

DURATION = 4.0
SIGMA = (0.02, 0.02, 0.1)


def swum(like: Trial, cause: str, sizes: dict[str, float]) -> Trial:
    """Swim a trial with a cause of given sizes."""
    model = Model(load_fish("pike"), (find(cause),))
    return replace(like, velocity=readonly(model.predict(like, model.values(sizes)).velocity))


def synthetic(cause: str, sizes: dict[str, float], mode_names: Sequence[str] = ("v1", "v3")) -> Dataset:
    """Return a dataset of one cause."""
    time = readonly(np.arange(int(DURATION * 50) + 1) / 50.0)
    still = readonly(np.zeros((len(time), 3)))
    blanks = [Trial(mode, "fit", time, still, modes.drive(mode)) for mode in mode_names]
    trials = tuple(swum(blank, cause, sizes) for blank in blanks)
    return Dataset("synthetic", load_fish("pike"), trials, noise=readonly(SIGMA))
