"""Tests of the data that need no fit: what `diagnose` runs first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset, Trial, load_dataset
from mjfish.effects import Causes, catalogue
from mjfish.estimation.clocks import aligned
from mjfish.inspection import nominal_simulation as nominal
from mjfish.inspection.finding import Finding
from mjfish.inspection.joint_motion import unresolved
from mjfish.inspection.kinematics import compatibility, disagreements
from mjfish.inspection.nominal_simulation import Drive, Guess
from mjfish.inspection.poses import pose_findings
from mjfish.inspection.repeats import noise_from_repeats, repeat_findings
from mjfish.inspection.result import Inspection
from mjfish.inspection.runs import missing_runs
from mjfish.inspection.samples import copies, interpolated, outliers, pooled, stuck
from mjfish.inspection.wave_frequency import wave_frequencies
from mjfish.model import Model


def inspect(dataset: Dataset | str | Path, effects: Causes = None) -> Inspection:
    """Test a dataset before anything is fitted to it: signs, units, labels, clocks, copies, missing runs.

    Velocities are in m/s and rad/s, times in s, as `mjfish.load_dataset` reads them. Nothing is raised for bad data:
    each fault is a `Finding` with a code, a place, what was expected, and a remedy. Of trials without all three
    velocities, places, headings and joints are tested.

    Args:
        dataset: the trials, or the folder of ``dataset.toml``.
        effects: the causes that findings may concern, by name, or Python files with causes of your own; None: the
            shipped ones.

    Returns:
        The findings, the worst first; those of severity ``blocks`` make a diagnosis worthless.

    Raises:
        InputError: `dataset` is a folder that cannot be read, or has no trial to fit; a file of effects is none.

    Example:
        >>> import mjfish
        >>> dataset = mjfish.generate("pike", ["v1", "v3-t1"], noise=(0.01, 0.01, 0.05))
        >>> [finding.code for finding in mjfish.inspect(dataset).findings]
        ['design-one-frequency', 'design-no-turn']
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    known = catalogue(effects)
    complete = tuple(trial for trial in dataset.trials if trial.measured.all())
    others = [trial for trial in dataset.trials if not trial.measured.all()]
    beside = [*nominal.time_units(others, {trial.name: nominal.time_factor(trial) for trial in others})]
    beside += [*pose_findings(dataset), *(finding for trial in others for finding in unresolved(trial))]
    if not complete:
        return Inspection.of([*beside, *missing_runs(dataset, known)], known)
    whole, dataset = dataset, replace(dataset, trials=complete)
    frequencies, dataset = list(wave_frequencies(dataset.trials)), aligned(dataset)
    held = [trial.name for trial in whole.split()[1]]
    found = [finding for trial in dataset.trials for finding in stuck(trial)]
    silent = {name for finding in found if finding.severity == "blocks" for name in finding.trials}
    trials = [trial for trial in dataset.trials if trial.name not in silent]
    found += nominal.sampling(trials, [nominal.sampled_enough(trial) for trial in trials])
    factors = {trial.name: nominal.time_factor(trial) for trial in dataset.trials}
    found += nominal.time_units(trials, factors)
    # Other units show only where the times are right.
    trials = [nominal.retimed(trial, factors[trial.name]) for trial in trials]
    dataset = replace(dataset, trials=tuple(nominal.retimed(trial, factors[trial.name]) for trial in dataset.trials))
    fine = [trial for trial in trials if nominal.sampled_enough(trial)]
    lines = [line for line in map(interpolated, fine) if line is not None]
    noise = pooled(lines)
    found += frequencies
    found += [finding for trial in trials for finding in unresolved(trial)]
    found += copies(trials, held, noise, lines)
    found += _against_simulation(dataset, fine, noise)
    harmless = ("copies", "joints", "sampling")
    misread = {name for finding in found if not finding.code.startswith(harmless) for name in finding.trials}
    found += outliers([line for line in lines if line.trial.name not in misread])
    pair = compatibility(trials)
    if pair is not None:
        found += disagreements(pair)
    spoiled = {
        name
        for finding in found
        if finding.severity == "blocks" or finding.code.startswith("copies")
        for name in finding.trials
    }
    repeats = noise_from_repeats(dataset, leave_out=sorted(spoiled))
    if repeats is not None:
        found += repeat_findings(repeats)
    retimed = {trial.name: trial for trial in dataset.trials}
    every = replace(whole, trials=tuple(retimed.get(trial.name, trial) for trial in whole.trials))
    return Inspection.of([*beside, *found, *missing_runs(every, known)], known, pair, repeats)


@dataclass(frozen=True, eq=False)
class _Guessed:
    """A trial with its nominal simulations, one a set of coefficients."""

    trial: Trial
    guesses: list[Guess]

    @property
    def nearest(self) -> Guess:
        """The guess whose surge is nearest to the measured one."""
        apart = [float(np.sum((self.trial.velocity[:, 0] - guess.velocity[:, 0]) ** 2)) for guess in self.guesses]
        return self.guesses[int(np.argmin(apart))]


def _against_simulation(dataset: Dataset, trials: Sequence[Trial], noise: FloatArray) -> list[Finding]:
    """Hold trials against the nominal simulation: units, signs, labels, starts."""
    model = Model(dataset.fish)
    sets = nominal.value_sets(dataset.fish)
    found: list[Finding] = []
    sizes: dict[str, FloatArray] = {}
    scores: dict[str, dict[nominal.Reading, float]] = {}
    kept = []
    for trial in trials:
        every = [nominal.guesses(model, trial, [trial.drive], values)[0] for values in sets]
        guess = _Guessed(trial, [one for one in every if one is not None])
        if not guess.guesses:
            continue
        starts = list(nominal.start_findings(trial, guess.nearest.velocity, noise))
        found += starts
        if any(finding.severity == "blocks" for finding in starts):
            continue
        size = nominal.size(trial, guess.guesses)
        if size is not None:
            sizes[trial.name] = size
        scores[trial.name] = nominal.scores(trial, guess.guesses)
        kept.append(trial)
    turned = [*nominal.units(sizes), *nominal.signs(scores)]
    found += turned
    if turned:  # a run that is read wrongly has no label to speak of
        return found
    trials = kept
    drives = list(dict.fromkeys(trial.drive for trial in trials if trial.drive))
    if drives:
        tables = [nominal.costs(model, trials, drives, values) for values in sets]
        own = [_own_cost(trials, drives, table) for table in tables]
        found += nominal.labels(trials, drives, tables[int(np.argmin(own))])
    return found


def _own_cost(trials: Sequence[Trial], drives: Sequence[Drive], table: FloatArray) -> float:
    own = [table[i, drives.index(trial.drive)] for i, trial in enumerate(trials) if trial.drive]
    return float(np.sum(own))
