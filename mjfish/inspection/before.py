"""All checks that need no fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset, Trial
from mjfish.effects import Effect, catalogue
from mjfish.inspection import guess, judged, signs
from mjfish.inspection.compatibility import compatibility
from mjfish.inspection.copies import copies
from mjfish.inspection.design import design
from mjfish.inspection.finding import Checks, Finding, ordered
from mjfish.inspection.guess import Guess
from mjfish.inspection.labels import costs, labels
from mjfish.inspection.outliers import outliers
from mjfish.inspection.repeats import noise_from_repeats
from mjfish.inspection.smooth import pooled, smooth
from mjfish.inspection.stuck import stuck
from mjfish.model import Model


def inspect(dataset: Dataset, effects: Mapping[str, Effect] | None = None) -> Checks:
    """Check a dataset before anything is fitted to it.

    Args:
        dataset: any that `mjfish.data.load_dataset` accepts.
        effects: causes that may be asked for, by name; None: the shipped catalogue. What the design of the dataset
            cannot tell apart is read from their fingerprints.
    """
    held = [trial.name for trial in dataset.split()[1]]
    found = [finding for trial in dataset.trials for finding in stuck(trial)]
    silent = {name for one in found if one.severity == "blocks" for name in one.trials}
    trials = [trial for trial in dataset.trials if trial.name not in silent]
    enough = [guess.sampled_enough(trial) for trial in trials]
    fine = [trial for trial, good in zip(trials, enough, strict=True) if good]
    lines = [one for one in map(smooth, fine) if one is not None]
    noise = pooled(lines)
    found += copies(trials, held, noise)
    found += judged.sampling(trials, enough)
    found += _against_simulation(dataset, fine, noise)
    bent = {name for one in found if one.check != "copies" for name in one.trials}
    found += outliers([one for one in lines if one.trial.name not in bent])
    pair = compatibility(trials)
    if pair is not None:
        found += judged.of_compatibility(pair)
    spoiled = {name for one in found if one.severity == "blocks" or one.check == "copies" for name in one.trials}
    repeats = noise_from_repeats(dataset, leave_out=sorted(spoiled))
    if repeats is not None:
        found += judged.of_repeats(repeats)
    found += design(dataset, catalogue() if effects is None else effects)
    return Checks(ordered(found), pair, repeats)


@dataclass(frozen=True, eq=False)
class _Guessed:
    """A trial with its nominal simulations, one a set of coefficients."""

    trial: Trial
    guesses: list[Guess]

    @property
    def nearest(self) -> Guess:
        """The guess whose surge is nearest to the measured one."""
        apart = [float(np.sum((self.trial.velocity[:, 0] - one.velocity[:, 0]) ** 2)) for one in self.guesses]
        return self.guesses[int(np.argmin(apart))]


def _against_simulation(dataset: Dataset, trials: Sequence[Trial], noise: FloatArray) -> list[Finding]:
    """Hold trials against the nominal simulation: units, signs, labels, starts."""
    model = Model(dataset.fish)
    sets = guess.value_sets(dataset.fish)
    guessed = []
    for trial in trials:
        every = [guess.guesses(model, trial, [trial.drive], values)[0] for values in sets]
        guessed.append(_Guessed(trial, [one for one in every if one is not None]))
    guessed = [one for one in guessed if one.guesses]
    found: list[Finding] = []
    for one in guessed:
        found += judged.of_start(one.trial, one.nearest.velocity, noise)
    moving = {name for one in found if one.severity == "blocks" for name in one.trials}
    guessed = [one for one in guessed if one.trial.name not in moving]
    sizes = {one.trial.name: signs.size(one.trial, one.guesses) for one in guessed}
    turned = list(signs.units({name: size for name, size in sizes.items() if size is not None}))
    turned += signs.signs({one.trial.name: signs.scores(one.trial, one.guesses) for one in guessed})
    found += turned
    if turned:  # a run that is read wrongly has no label to speak of
        return found
    trials = [one.trial for one in guessed]
    drives = list(dict.fromkeys(trial.drive for trial in trials if trial.drive))
    if drives:
        tables = [costs(model, trials, drives, values) for values in sets]
        own = [_own_cost(trials, drives, table) for table in tables]
        found += labels(trials, drives, tables[int(np.argmin(own))])
    return found


def _own_cost(trials: Sequence[Trial], drives: Sequence[guess.Drive], table: FloatArray) -> float:
    own = [table[i, drives.index(trial.drive)] for i, trial in enumerate(trials) if trial.drive]
    return float(np.sum(own))
