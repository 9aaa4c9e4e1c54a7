"""The run that holds all of a misfit: something happened in it that is in no other.

Two causes and more, fitted to all runs, can imitate what was odd in one. The nominal model is fitted without it, and
the joint score of all candidates and the omnibus basis say whether the others contradict it at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence, gather, tail
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.estimation import fit
from mjfish.inspection import Finding

#: Fewest runs of which one can be the odd one, and how many are tried, those of which omnibus waves explain most: one
#: of the same drive may be as far off.
_FEWEST, _TRIED = 4, 2


def lone_run(evidence: Evidence) -> int | None:
    """Return the index of the fitted trial without which nothing contradicts the nominal model.

    None where there is none, or two.

    Args:
        evidence: of the nominal model.
    """
    problem = evidence.problem
    if len(problem.trials) < _FEWEST:
        return None
    systematic = evidence.waves.fitted(evidence.cleared)
    left = [float(np.sum(systematic[rows] ** 2)) for rows in problem.trial_rows]
    worst = sorted(range(len(left)), key=lambda index: -left[index])[:_TRIED]
    alone = [index for index in worst if _rest_fits(evidence, index)]
    return alone[0] if len(alone) == 1 else None


def _rest_fits(evidence: Evidence, index: int) -> bool:
    """Return whether nothing contradicts the nominal model, fitted without one trial."""
    every = evidence.problem.trials
    problem = replace(evidence.problem, trials=(*every[:index], *every[index + 1 :]), windows=None)
    found = fit(problem, problem.start(evidence.fit.values), tolerance=1e-6)
    if found.lost:
        return False
    after = gather(problem, found, evidence.candidates)
    return min(tail(*after.saturated()), tail(*after.omnibus)) >= THRESHOLDS.goodness


def odd_run(trials: Sequence[Trial], odd: int) -> Finding:
    """Return the finding about the run that holds all of the misfit."""
    name, drive = trials[odd].name, trials[odd].drive
    repeated = drive != () and sum(trial.drive == drive for trial in trials) > 1
    return Finding(
        "outlying-run",
        "suspect" if repeated else "remark",
        f"trial '{name}'",
        "without it, nothing contradicts the nominal model",
        "runs that all show what is wrong",
        "look at this run: another clock, scale, charge of the battery, or something in its way; diagnose without it"
        if repeated
        else "repeat it: alone at its drive, it cannot be told from a cause that shows only there",
        trials=(name,),
    )
