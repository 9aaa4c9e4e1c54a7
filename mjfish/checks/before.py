"""All checks that need no fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.checks import guess, judged, signs
from mjfish.checks.compatibility import compatibility
from mjfish.checks.copies import copies
from mjfish.checks.design import design
from mjfish.checks.finding import Checks, Finding, ordered
from mjfish.checks.guess import Guess
from mjfish.checks.labels import costs, labels
from mjfish.checks.outliers import outliers
from mjfish.checks.repeats import noise_from_repeats
from mjfish.checks.smooth import pooled, smooth
from mjfish.checks.stuck import stuck
from mjfish.effects import Effect, catalogue
from mjfish.model import Model
from mjfish.trial import Dataset, Trial


def run(dataset: Dataset, effects: Mapping[str, Effect] | None = None) -> Checks:
    """Check a dataset before anything is fitted to it.

    Args:
        dataset: any that `mjfish.trial.load` accepts.
        effects: causes that may be asked for, by name; None: the shipped catalogue. What the design of the dataset
            cannot tell apart is read from their fingerprints.
    """
    trials = dataset.trials
    held = [trial.name for trial in dataset.split()[1]]
    lines = [one for one in map(smooth, trials) if one is not None]
    noise = pooled(lines)
    found: list[Finding] = []
    found += copies(trials, held, noise)
    copied = [name for one in found if one.check == "copies" for name in one.trials]
    found += [finding for trial in trials for finding in stuck(trial)]
    found += outliers(lines)
    enough = [guess.sampled_enough(trial) for trial in trials]
    found += judged.sampling(trials, enough)
    found += _against_simulation(dataset, [t for t, fine in zip(trials, enough, strict=True) if fine], noise)
    pair = compatibility(trials)
    if pair is not None:
        found += judged.of_compatibility(pair)
    repeats = noise_from_repeats(dataset, leave_out=copied)
    if repeats is not None:
        found += judged.of_repeats(repeats)
    found += design(dataset, catalogue() if effects is None else effects)
    return Checks(ordered(found), pair, repeats)


@dataclass(frozen=True, eq=False)
class _Guessed:
    """A trial with its nominal simulations, one a set of coefficients."""

    trial: Trial
    guesses: list[Guess | None]


def _against_simulation(dataset: Dataset, trials: Sequence[Trial], noise: FloatArray) -> list[Finding]:
    """Hold trials against the nominal simulation: units, signs, labels, starts."""
    model = Model(dataset.fish)
    sets = guess.value_sets(dataset.fish)
    guessed = [
        _Guessed(trial, [guess.guesses(model, trial, [trial.drive], values)[0] for values in sets]) for trial in trials
    ]
    guessed = [one for one in guessed if any(guess is not None for guess in one.guesses)]
    sizes = {one.trial.name: signs.size(one.trial, one.guesses) for one in guessed}
    found = list(signs.units({name: size for name, size in sizes.items() if size is not None}))
    turned = list(signs.signs({one.trial.name: signs.scores(one.trial, one.guesses) for one in guessed}))
    found += turned
    if found:  # a run that is read wrongly has neither a label nor a start to speak of
        return found
    drives = list(dict.fromkeys(trial.drive for trial in trials if trial.drive))
    if len(drives) > 1:
        tables = [costs(model, trials, drives, values) for values in sets]
        own = [_own_cost(trials, drives, table) for table in tables]
        found += labels(trials, drives, tables[int(np.argmin(own))])
    wrong = {name for one in found for name in one.trials}
    for one in guessed:
        if one.trial.name not in wrong:
            nearest = min((g for g in one.guesses if g is not None), key=lambda g: _apart(one.trial, g))
            found += judged.of_start(one.trial, nearest.velocity, noise)
    return found


def _own_cost(trials: Sequence[Trial], drives: Sequence[guess.Drive], table: FloatArray) -> float:
    own = [table[i, drives.index(trial.drive)] for i, trial in enumerate(trials) if trial.drive]
    return float(np.sum(own))


def _apart(trial: Trial, one: Guess) -> float:
    return float(np.sum((trial.velocity[:, 0] - one.velocity[:, 0]) ** 2))
