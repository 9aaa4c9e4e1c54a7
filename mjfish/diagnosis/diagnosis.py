"""The method in one place: inspect, screen, refit, select, combine, decide, and measure the gain on held-out trials."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from mjfish.data import Dataset, load_dataset
from mjfish.data.validation import check_comparable
from mjfish.diagnosis.assembly import assemble, unfinished_diagnosis
from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.compared import compare, weighed
from mjfish.diagnosis.conclusion import conclude
from mjfish.diagnosis.failures import NOMINAL, PartFailedError, Parts, noting, raised_in, tried
from mjfish.diagnosis.held_out import HeldOut
from mjfish.diagnosis.implausible_noise import bursts, too_large
from mjfish.diagnosis.provenance import identity
from mjfish.diagnosis.result import Diagnosis
from mjfish.diagnosis.screening import Screening, screen
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import Causes, Effect, catalogue, of_fish
from mjfish.errors import NUMERIC, InputError, MjfishError, reason_of
from mjfish.estimation import Noise
from mjfish.estimation.clocks import aligned
from mjfish.estimation.nominal import check_enough, first_sigma, nominal_problem
from mjfish.execution import PastLimitError, executing, execution
from mjfish.execution.checkpoint import Checkpoint
from mjfish.execution.progress import Meter, Progress, silent
from mjfish.inspection import Finding, Inspection, inspect, inspect_fit

#: Said of a cause that is a part of the nominal model.
_PART = "it is a part of the nominal model, and fitted with it"
#: The part that fails where no other one is to blame.
_WHOLE = "the comparison"


def diagnose(
    dataset: Dataset | str | Path,
    *,
    effects: Causes = None,
    seed: int = 0,
    jobs: int | None = None,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    limit: float | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Find out what is wrong with the simulation of a dataset, name the cause, and measure the gain.

    The nominal model is fitted to the fit trials, and its residual is tested for anything systematic. If there is some,
    every candidate is fitted together with the coefficients; a likelihood ratio with simulated null distributions
    ([Cox1961]) says which of them the data support. Velocities are in m/s and rad/s, sizes in the units of the effects.

    Args:
        dataset: the trials, split into fit and held out (see `Dataset.split`), or the folder of ``dataset.toml``.
        effects: candidates by name, or Python files with causes of your own, which are tried beside the shipped ones;
            None: the shipped ones.
        seed: of the bootstrap of the gain; no verdict depends on it.
        jobs: threads; None: one per processor. The answer does not depend on it.
        executor: `concurrent.futures.Executor` that takes the refits in place of the threads, such as one of Dask. The
            answer does not depend on it.
        resume: folder for finished refits; made where it is not there. A diagnosis that was stopped finds them there,
            and gives the same answer. None: they are kept nowhere.
        limit: seconds that one try of a candidate may take; the clock is looked at before every simulation, so that
            code that never returns is not ended. None: however long. A limit that is not reached changes no answer.
        progress: called with what is being done and the share that is done.

    A candidate that fails, because its effect raises, its refit diverges or the limit is reached, is left out from
    there on; other parts that fail are left out, too. `Diagnosis.failures` has the reasons, and nothing is claimed: the
    verdict is then ``cannot_tell`` or ``unexplained``.

    Returns:
        The verdict (``named``, ``nothing_wrong``, ``cannot_tell`` or ``unexplained``) with causes, sizes, the gain on
        held-out trials, rivals, findings about the data, and both models.

    Raises:
        InputError: the dataset cannot be read, has too few numbers, or no effect applies to it; the folder of `resume`
            cannot be written.
        WorkerError: a worker of the executor ended without an answer.

    Example:
        >>> import mjfish
        >>> truth = {"servo_lag.time_constant": 0.03}
        >>> noise = (0.006, 0.006, 0.04)
        >>> pool = mjfish.generate("pike", ["v1", "v3", "v5"], values=truth, noise=noise, duration=4.0)
        >>> mjfish.diagnose(pool).verdict
        'named'
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    if limit is not None and not limit > 0.0:
        raise InputError(f"limit: found {limit:g} s, expected more than 0; give seconds, or none")
    # small matrices: more threads of BLAS wait for each other
    here = executing(jobs, executor, limit=limit, meter=Meter(progress))
    with threadpool_limits(1, "blas"), noting(Parts()) as parts, here:
        known = catalogue(effects)
        begun = replace(_begun(dataset, known, parts), seed=seed)
        kept = None if resume is None else Checkpoint(Path(resume), identity(begun.measured, begun.candidates, seed))
        try:
            with executing(checkpoint=kept):
                return _diagnosed(begun)
        except PartFailedError as error:
            begun.parts.failures.update([error.args])
        except Exception as error:
            found = raised_in(error)
            if not found and (isinstance(error, MjfishError) or not isinstance(error, (*NUMERIC, PastLimitError))):
                raise
            begun.parts.failures[found or _WHOLE] = reason_of(error)
        return unfinished_diagnosis(begun)


def _begun(dataset: Dataset, effects: Mapping[str, Effect], parts: Parts) -> Begun:
    """Return what a diagnosis starts with."""
    check_comparable(dataset, "a diagnosis")
    measured, dataset = dataset, aligned(dataset)
    fitted, _ = dataset.split()
    stated = None if dataset.noise is None else np.asarray(dataset.noise)
    problem = nominal_problem(dataset, fitted, Noise.white(first_sigma(fitted) if stated is None else stated))
    candidates: list[Effect] = []
    reasons: dict[str, str] = {}
    for effect in effects.values():
        own = tried([effect.name], partial(_of_fish, effect, dataset), effect)
        reason = _PART if own.name in problem.nominal else tried([own.name], partial(own.not_applicable, dataset), "")
        candidates.append(own)
        reasons[own.name] = reason
    if not parts.failures and all(reasons[e.name] or e.learned or e.random for e in candidates):
        raise InputError(f"{dataset.name}: none of the {len(candidates)} effects applies to this dataset; add one")
    check_enough(problem, dataset.name)
    return Begun(measured, dataset, tuple(candidates), reasons, parts, stated, problem)


def _of_fish(effect: Effect, dataset: Dataset) -> Effect:
    """Return an effect as the fish has it, with priors that can be asked for."""
    (own,) = of_fish({effect.name: effect}, dataset.fish).values()
    own.priors()
    return own


def _diagnosed(begun: Begun) -> Diagnosis:
    """Diagnose without the candidates that failed: inspect, screen, compare, conclude, and put the result together."""
    if not begun.applicable:
        raise PartFailedError(_WHOLE, "no candidate is left that could be tried")
    execution().meter.stage("testing the data", 0.02)
    checks = begun.parts.run("the tests of the data", lambda: inspect(begun.measured, begun.known), Inspection())
    screening = screen(begun.problem, begun.applicable, begun.stated, walks=begun.walks)
    checks = checks.joined(_checks_of_fit(begun, screening, checks))
    nothing = dict[Finding, Finding](), tuple[Row, ...]()
    refuted, corrections = begun.parts.run(
        "the corrections of the data", lambda: weighed(checks.blocks, begun.measured), nothing
    )
    checks = checks.changed(refuted)
    execution().meter.stage("comparing the candidates", 0.6)
    held_out = HeldOut(screening.evidence, begun.dataset.split()[1])
    compared = compare(begun, screening, held_out, checks.blocks, corrections)
    concluded = conclude(begun, screening, compared, held_out)
    execution().meter.stage("looking at what is wrong", 0.99)
    result = assemble(begun, screening, checks, compared, concluded, held_out)
    execution().meter.stage("done", 1.0)
    return result


def _checks_of_fit(begun: Begun, screening: Screening, before: Inspection) -> Inspection:
    """Return what the nominal fit says of the data and their noise; that it was stopped is noted as a failure."""
    evidence, parts, known = screening.evidence, begun.parts, begun.known
    problem, nominal = evidence.problem, evidence.fit
    if nominal.status == "stopped":
        parts.failures[NOMINAL] = f"it stopped after {nominal.evaluations} evaluations: {nominal.message}"
    held = begun.dataset.split()[1]
    checks = parts.run("the tests of the fit", lambda: inspect_fit(problem, nominal, known, held), Inspection())
    if screening.p_wrong < THRESHOLDS.alarm or not problem.samples:
        return checks
    repeats = before.joined(checks).repeats
    implausible: tuple[Finding | None, ...] = parts.run(
        "the test of the noise", lambda: (too_large(problem, nominal, repeats), bursts(evidence)), ()
    )
    return checks.joined(Inspection.of((finding for finding in implausible if finding is not None), known))
