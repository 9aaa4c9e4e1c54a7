"""Comparisons of sets of causes: of single ones, and of combinations where no single one suffices.

The walk of the drive's clock is a row of the table, too: a random cause, whose size is a part of the noise. All
candidates are compared beside it. Its evidence is twice the marginal log-likelihood that it gains. It predicts no
run better, for nobody knows the walk of the next one: so it has no held-out figures.

A single run may hold all of a misfit: something happened in it that is in no other. Two causes and more, fitted to all
runs, can imitate what was odd in one. The nominal model is fitted without it, and the joint score of all candidates and
the omnibus basis say whether the others contradict it at all.

Corrections of the data that findings propose are rows, too: a flipped channel is a hypothesis like a cause. The nominal
model is fitted to the data as they stand and as they would be if the finding were true, each under the
white noise sigma that its third differences show. Of the numbers y as they were measured, n of every channel c,

    log L = - 1/2 |r|^2 - n sum_c log sigma_c + sum_runs n_r sum_c log |y_c|,

up to a constant that both have: the last term is the Jacobian of a change of units. Twice what a correction adds is its
evidence. A finding whose correction explains no more than chance does blocks nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.combinations import Found, beside, find_combinations
from mjfish.diagnosis.evidence import Evidence, gather, tail
from mjfish.diagnosis.forms import refit_learned_forms
from mjfish.diagnosis.held_out import HeldOut, pooled_error
from mjfish.diagnosis.refit import converged_in_reach, far_off, lowest
from mjfish.diagnosis.refit_result import Refit, followed
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.select import Goodness, compared
from mjfish.diagnosis.servo_delay import servo_delays
from mjfish.diagnosis.table import Comparison, Estimate, Names, Row, Table, estimates
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects.clock_wander import ClockWander
from mjfish.estimation import Fit, Noise, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.fit import Z95
from mjfish.estimation.marginal_likelihood import log_likelihood_gained, walk_size
from mjfish.estimation.nominal import first_sigma, nominal_problem
from mjfish.estimation.residual import channel_errors
from mjfish.inspection import Finding

#: Of how many formulas, the best, lower minima are looked for where none leaves nothing.
_LEADERS = 2


@dataclass(frozen=True, eq=False)
class Compared:
    """All comparisons of a diagnosis.

    Attributes:
        table: what the verdict is read from.
        refits: of all sets.
        learned: refits of learned forms, by name.
        odd: index of the run that holds all of the misfit; None where none does.
    """

    table: Table
    refits: Mapping[Names, Refit] = field(default_factory=dict)
    learned: Mapping[str, Refit] = field(default_factory=dict)
    odd: int | None = None


def compare(
    begun: Begun, screening: Screening, held_out: HeldOut, blocks: Sequence[Finding], corrections: Sequence[Row]
) -> Compared:
    """Compare the candidates with each other, and on the held-out trials; where none suffices, combine them.

    Args:
        begun: what the diagnosis started with.
        screening: of the nominal model.
        held_out: what refits predict of the held-out trials.
        blocks: findings about the data with which no verdict is worth its words.
        corrections: rows of corrections of the data.
    """
    walk = partial(random_causes, screening.evidence, screening.p_wrong)
    table = Table(
        screening.p_wrong,
        blocks=tuple(block.message for block in blocks),
        corrections=tuple(corrections),
        random=begun.parts.run("the walk of the clock", walk, tuple[Row, ...]()),
    )
    found = _compared(begun, screening, held_out, table)
    return replace(found, table=found.table.described(lambda row: _described(row, found.refits[row.names], held_out)))


def _described(row: Row, refit: Refit, held_out: HeldOut) -> Row:
    own = {p.name for effect in refit.effects for p in effect.parameters}
    return replace(
        row,
        error=pooled_error(channel_errors(refit.problem, refit.fit.x)),
        held_out_error=pooled_error(held_out.score(refit).channels) if held_out.trials else None,
        sizes={name: value for name, value in estimates(refit.fit, refit.problem.model).items() if name in own},
        delays=servo_delays(refit),
    )


def _compared(begun: Begun, screening: Screening, held_out: HeldOut, table: Table) -> Compared:
    refits: dict[Names, Refit] = {(name,): refit for name, refit in screening.refits.items()}
    if not refits:
        return Compared(table)
    refits |= _caught_up(refits)
    goodness = Goodness(begun.applicable, held_out)
    single = _singles(refits, goodness, held_out)
    if table.blocks:  # whatever else is found, no verdict is given
        return Compared(replace(table, single=single), refits)
    settled = {row.mechanisms[0] for row in single.settled()}
    evidence = cache(partial(beside, (*begun.applicable, *begun.learnable)))
    odd = cache(lambda: begun.parts.run("the search for a single run", lambda: outlying_run(screening.evidence), None))
    found: Found = (None, refits)
    # pairs of formulas take less time than learned forms and lower minima, and may leave them nothing to explain
    if not settled and odd() is None:
        pairs = partial(find_combinations, refits, evidence, goodness, formulas=True)
        found = begun.parts.run("the combinations", pairs, found)
    sufficient = [found[1][row.names] for row in (found[0] or Comparison()).settled()]
    learned = refit_learned_forms(screening.evidence, begun.learnable, settled, screening.refits, sufficient)
    if learned:
        refits |= {(name,): refit for name, refit in learned.items()}
        refits |= _caught_up(refits)
        learned = {name: refits[name,] for name in learned}
        single = _singles(refits, goodness, held_out)
    if not (sufficient or single.settled()):
        leaders = sorted((refit for refit in refits.values() if not refit.learned), key=lambda refit: -refit.adjusted)
        lower = [refit for refit in followed(lowest, leaders[:_LEADERS]) if refit.gain > refits[refit.names].gain]
        if lower:
            refits |= {refit.names: refit for refit in lower}
            single = _singles(refits, goodness, held_out)
    table = replace(table, single=single)
    if single.retained(clean=True):
        return Compared(table, refits, learned)
    if not sufficient and odd() is None:
        every = partial(_combined, single, {**found[1], **refits}, evidence, goodness)
        found = begun.parts.run("the combinations", every, found)
    if failed := {row.names for row in single.failed()}:
        others = _singles({names: refit for names, refit in refits.items() if names not in failed}, goodness, held_out)
        table = replace(table, others=others)
    return Compared(replace(table, several=found[0]), {**found[1], **refits}, learned, odd())


def _caught_up(refits: Mapping[Names, Refit]) -> dict[Names, Refit]:
    """Follow the refits that were stopped where a step more may catch up with the best; return these."""
    stopped, best = [refit for refit in refits.values() if refit.promise], max(refit.gain for refit in refits.values())
    return {refit.names: refit for refit in converged_in_reach(stopped, best)}


def _singles(refits: Mapping[Names, Refit], goodness: Goodness, held_out: HeldOut) -> Comparison:
    """Compare single causes with each other, and on the held-out trials."""
    found = compared(refits, goodness)
    return found.with_held_out({row.names: held_out.confirmed(refits[row.names], None) for row in found.staying()})


def _combined(
    single: Comparison, refits: Mapping[Names, Refit], evidence: Callable[[Refit], Evidence], goodness: Goodness
) -> Found:
    """Compare combinations of causes, and return all refits; None where no second cause is seen.

    Where all that stay have a learned form and fail on the held-out trials, those of formulas alone are compared.
    """
    found, known = find_combinations(refits, evidence, goodness, small=single.exhausted())
    if found is not None and all(row.learned and row.fails() for row in found.staying()):
        formulas = {names: refit for names, refit in known.items() if not refit.learned}
        again, more = find_combinations(formulas, evidence, goodness, small=single.exhausted(), formulas=True)
        return (found if again is None else again), {**known, **more}
    return found, known


def random_causes(evidence: Evidence, p_wrong: float) -> tuple[Row, ...]:
    """Return the row of the walk that is a part of the nominal fit; none where there is none.

    Args:
        evidence: at the fit of the nominal model.
        p_wrong: p value of the nominal model beside the walk.
    """
    problem, found = evidence.problem, evidence.fit
    if not problem.walk:
        return ()
    size, determined = walk_size(problem, found)
    left, rank = evidence.omnibus
    gain = 2.0 * log_likelihood_gained(problem, found)
    half = Z95 / np.sqrt(2.0 * determined)  # of the logarithm of an sd
    low, high = size * float(np.exp(-half)), size * float(np.exp(half))
    row = replace(
        Row.apart(ClockWander.name, ClockWander.summary, ClockWander.mechanism, gain, found.status),
        tests={"candidates and waves": p_wrong},
        excess=max(left - rank, 0.0),
        rank=rank,
        sizes={ClockWander.parameters[0].name: Estimate(size, low, high, ClockWander.parameters[0].unit)},
    )
    return (row,)


#: Fewest runs of which one can be the odd one, and how many are tried, those of which omnibus waves explain most: one
#: of the same drive may be as far off. Evaluations after which the nominal model is near, if it fits the others.
_FEWEST, _TRIED, _TRY = 4, 2, 15


def outlying_run(evidence: Evidence) -> int | None:
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
    found = fit(problem, problem.start(evidence.fit.values), tolerance=1e-6, evaluations=_TRY)
    if found.lost or far_off(found):
        return False
    after = gather(problem, found, evidence.candidates)
    return min(tail(*after.saturated()), tail(*after.omnibus)) >= THRESHOLDS.goodness


def outlying_run_finding(trials: Sequence[Trial], odd: int) -> Finding:
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


#: Keeps the logarithm of a channel that stands still finite.
_STILL = 1e-300


def weighed(blocks: tuple[Finding, ...], dataset: Dataset) -> tuple[dict[Finding, Finding], tuple[Row, ...]]:
    """Return the refuted findings as suspects, and a row for every correction whose fit did not diverge.

    Args:
        blocks: findings with which no verdict could be given.
        dataset: as it was measured.
    """
    rows = dict(_corrections(blocks, dataset))
    refuted = {finding: _refuted(finding) for finding, row in rows.items() if row.p_value >= THRESHOLDS.keep}
    return refuted, tuple(rows.values())


def _refuted(finding: Finding) -> Finding:
    found = f"{finding.found}; yet corrected so, the nominal model fits no better"
    return replace(finding, severity="suspect", found=found)


def _corrections(blocks: tuple[Finding, ...], dataset: Dataset) -> Iterator[tuple[Finding, Row]]:
    """Yield the findings that propose a correction, and their rows."""
    proposed = [(finding, finding.corrected(dataset)) for finding in blocks if finding.corrected is not None]
    if not proposed:
        return
    nominal = _nominal_fit(dataset)
    for finding, corrected in proposed:
        found = _nominal_fit(corrected)
        if not (nominal.lost or found.lost):
            yield (
                finding,
                _correction(
                    finding, 2.0 * (_log_likelihood(found, corrected) - _log_likelihood(nominal, dataset)), found
                ),
            )


def _nominal_fit(dataset: Dataset) -> Fit:
    """Fit the nominal model to all trials, for held-out ones may be read wrongly, too."""
    dataset = aligned(dataset)
    problem = nominal_problem(dataset, dataset.trials, Noise.white(first_sigma(dataset.trials)))
    return fit(problem, problem.start(), tolerance=1e-4)


def _log_likelihood(found: Fit, dataset: Dataset) -> float:
    """Return log L of a fit to a dataset; channels that were not measured do not count."""
    spread = np.log(first_sigma(dataset.trials))
    sizes = [
        len(trial.time) * (np.log(np.linalg.norm(trial.velocity, axis=0) + _STILL) - spread) for trial in dataset.trials
    ]
    return float(np.nansum(sizes) - 0.5 * found.sse)


def _correction(finding: Finding, gain: float, found: Fit) -> Row:
    """Return the row of a correction; the choice counts as one parameter."""
    name, rank = f"{finding.code} ({finding.place})", found.count - len(found.x)
    return replace(
        Row.apart(name, finding.found, finding.code, gain, found.status),
        tests={"noise": tail(found.sse, rank)},
        excess=max(found.sse - rank, 0.0),
        rank=rank,
    )
