"""The whole way from a dataset to a verdict and the gain it brings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from mjfish.data import Dataset, load_dataset
from mjfish.diagnosis import assemble, heldout, provenance
from mjfish.diagnosis.bursts import bursts
from mjfish.diagnosis.description import describe
from mjfish.diagnosis.fingerprint import fingerprint
from mjfish.diagnosis.force import missing_force
from mjfish.diagnosis.heldout import HeldOut
from mjfish.diagnosis.locate import locate
from mjfish.diagnosis.magnitude import too_large
from mjfish.diagnosis.progress import Progress, part, silent
from mjfish.diagnosis.refit import Refit
from mjfish.diagnosis.result import Diagnosis
from mjfish.diagnosis.search import search
from mjfish.diagnosis.select import standings
from mjfish.diagnosis.several import several
from mjfish.diagnosis.verdict import ALARM, Hearing, Ruling, rule
from mjfish.effects import Effect, catalogue, of_fish
from mjfish.errors import InputError
from mjfish.estimation import Noise, Problem
from mjfish.estimation.clocks import aligned
from mjfish.estimation.identification import check_enough, first_sigma
from mjfish.inspection import Inspection, inspect, inspect_fit
from mjfish.model import Model


def diagnose(
    dataset: Dataset | str | Path,
    *,
    effects: Mapping[str, Effect] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Find out what is wrong with the simulation of a dataset, name the cause, and measure the gain.

    The nominal model is fitted to the fit trials, and its residual is tested for anything systematic. If there is some,
    every candidate is fitted together with the coefficients; a likelihood ratio with simulated null distributions
    ([Cox1961]) says which of them the data support. Velocities are in m/s and rad/s, sizes in the units of the effects.

    Args:
        dataset: the trials, split into fit and held out (see `Dataset.split`), or the folder of ``dataset.toml``.
        effects: candidates by name; None: the shipped catalogue.
        seed: of the simulated null distributions and the bootstrap; the same seed gives the same answer.
        jobs: threads; None: one per processor. The answer does not depend on it.
        progress: called with what is being done and the share that is done.

    Returns:
        The verdict (``named``, ``nothing_wrong``, ``cannot_tell`` or ``unexplained``) with causes, sizes, the gain on
        held-out trials, rivals, findings about the data, and both models.

    Raises:
        InputError: the dataset cannot be read, has too few numbers, or no effect applies to it.

    Example:
        >>> import mjfish
        >>> truth = {"servo_lag.time_constant": 0.03}
        >>> pool = mjfish.generate("pike", ["v1", "v5-v1", "v3"], values=truth, noise=(0.006, 0.006, 0.04))
        >>> mjfish.diagnose(pool).verdict
        'named'
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    with threadpool_limits(1, "blas"):  # small matrices: more threads only wait for each other
        return _diagnosed(dataset, effects, seed, jobs, progress)


def _diagnosed(
    dataset: Dataset, effects: Mapping[str, Effect] | None, seed: int, jobs: int | None, progress: Progress
) -> Diagnosis:
    rng = np.random.default_rng(seed)
    candidates = tuple(of_fish(catalogue() if effects is None else effects, dataset.fish).values())
    reasons = {effect.name: effect.not_applicable(dataset) for effect in candidates}
    applicable = tuple(effect for effect in candidates if not reasons[effect.name])
    dataset = aligned(dataset)
    fitted, held = dataset.split()
    if not applicable:
        raise InputError(f"{dataset.name}: none of the {len(candidates)} effects applies to this dataset; add one")
    stated = None if dataset.noise is None else np.asarray(dataset.noise)
    problem = Problem(
        Model(dataset.fish),
        fitted,
        Noise.white(stated if stated is not None else first_sigma(fitted)),
        free_clock=dataset.clock == "free",
        jobs=jobs or os.cpu_count() or 1,
    )
    check_enough(problem, dataset.name)
    known = {effect.name: effect for effect in candidates}
    checked = inspect(dataset, known)
    findings, noise_remark = search(problem, applicable, stated, rng, progress)
    evidence, refitted = findings.evidence, findings.refits
    checked = checked.joined(inspect_fit(evidence.problem, evidence.fit, known, held))
    if findings.p_wrong >= ALARM:
        taken_for_noise = too_large(evidence.problem, evidence.fit, checked.repeats), bursts(evidence, rng)
        found = (finding for finding in taken_for_noise if finding is not None)
        checked = checked.joined(Inspection.of(found, known))

    progress("comparing the candidates", 0.75)
    held_out = HeldOut(evidence, held)
    single = _heard(refitted, applicable, held_out, rng)
    several_, others = None, None
    if refitted and not single.staying(clean=True):
        several_ = _several(refitted, applicable, held_out, rng, progress)
        if failed := single.failed():
            rest = {name: one for name, one in refitted.items() if (name,) not in failed}
            others = _heard(rest, applicable, held_out, rng)
    ruling = rule(findings.p_wrong, single, several_, checked.blocks, others)
    best = _best(ruling, single, several_)
    scored = (held_out.score(None), held_out.score(best)) if held else None

    progress("looking at what is wrong", 0.96)
    wrong = findings.p_wrong < ALARM
    unexplained = ruling.verdict == "unexplained"
    final = evidence.fit if best is None else best.fit
    extended = evidence.problem if best is None else best.problem
    errors = {name: heldout.pooled_error(held_out.score(one).residuals, held) for name, one in refitted.items() if held}
    table = assemble.candidates(candidates, reasons, evidence, refitted, single.joined(others), errors)
    result = Diagnosis(
        dataset=dataset,
        verdict=ruling.verdict,
        message=ruling.message,
        status="ok" if {evidence.fit.status, final.status} == {"converged"} else "fit_not_converged",
        remarks=assemble.remarks(noise_remark, evidence, held),
        checks=checked,
        causes=assemble.causes(best) if ruling.verdict == "named" else (),
        rivals=assemble.rivals(ruling),
        alternatives=ruling.sets,
        certain=ruling.certain,
        candidates=table,
        undetectable=assemble.undetectable(table, evidence),
        best=() if best is None else best.names,
        where=locate(evidence, findings.directed) if wrong else None,
        force=missing_force(evidence.problem, evidence.fit) if wrong else (),
        fingerprint=None if best is None else fingerprint(best),
        description=describe(evidence.problem, evidence.fit, rng) if unexplained else None,
        p_wrong=findings.p_wrong,
        gain=heldout.gain(*scored, held, rng) if scored is not None and best is not None else None,
        nominal=assemble.estimates(evidence.fit, evidence.problem.model),
        extended=assemble.estimates(final, extended.model),
        nominal_model=evidence.problem.model,
        extended_model=extended.model,
        overlays=assemble.overlays(evidence, extended, final, held, scored),
        problem=evidence.problem,
        fits=assemble.fitted_models(evidence, refitted),
        effects={effect.name: effect for effect in candidates},
        provenance=provenance.provenance(dataset, candidates, seed),
    )
    progress("done", 1.0)
    return result


def _heard(
    refitted: Mapping[str, Refit], candidates: Sequence[Effect], held_out: HeldOut, rng: np.random.Generator
) -> Hearing:
    """Return what speaks for single causes: how they stand against each other, and on the held-out trials."""
    standing = standings(refitted, candidates, held_out, rng) if refitted else {}
    return Hearing(
        {(name,): one for name, one in refitted.items()},
        {(name,): one for name, one in standing.items()},
        {(name,): held_out.confirmed(refitted[name], None) for name, one in standing.items() if one.in_set},
    )


def _several(
    singles: Mapping[str, Refit],
    candidates: Sequence[Effect],
    held_out: HeldOut,
    rng: np.random.Generator,
    progress: Progress,
) -> Hearing | None:
    sets = several(singles, candidates, held_out, rng, part(progress, 0.8, 0.15))
    if sets is None:
        return None
    staying = [names for names, one in sets.standings.items() if one.in_set]
    confirmed = {names: held_out.confirmed(sets.refits[names], sets.parts[names]) for names in staying}
    return Hearing(sets.refits, sets.standings, confirmed)


def _best(ruling: Ruling, single: Hearing, several_: Hearing | None) -> Refit | None:
    """Return whose extended model is shown: the named one's, else that of the single cause that explains most."""
    for hearing in (single, several_):
        if hearing is not None and ruling.sets and ruling.sets[0] in hearing.refits:
            return hearing.refits[ruling.sets[0]]
    return max(single.refits.values(), key=lambda one: one.adjusted) if single.refits else None
