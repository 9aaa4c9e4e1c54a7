"""From a dataset and a question to a ranked plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal

import numpy as np

from mjfish.data import Dataset
from mjfish.design.calibration import settled
from mjfish.design.fitted import baseline, fit_rivals, with_noise_of_the_best
from mjfish.design.gain import NONE
from mjfish.design.menu import Menu, Run
from mjfish.design.odds import chance
from mjfish.design.question import Question, of_diagnosis
from mjfish.design.result import Option, Pair, Plan
from mjfish.design.separation import Distances, distances
from mjfish.design.visibility import Visibility, visibility
from mjfish.design.words import message
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.progress import Progress, part, silent
from mjfish.effects import catalogue
from mjfish.effects.catalogue import find
from mjfish.effects.effect import Effect
from mjfish.errors import InputError
from mjfish.estimation import Problem, fit
from mjfish.estimation.noise import estimate

#: Time between two runs, for the water to come to rest [s].
PAUSE = 30.0


def plan(
    dataset: Dataset,
    *,
    effects: Mapping[str, Effect] | None = None,
    menu: Menu | None = None,
    pause: float = PAUSE,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Plan:
    """Diagnose a dataset, and say what to do next about what the diagnosis leaves open.

    Args:
        dataset: with its trials.
        effects: candidates by name; None: the shipped catalogue.
        menu, pause, jobs, progress: as in `advise`.
        seed: as in `mjfish.diagnosis.diagnose`.
    """
    found = diagnose(dataset, effects=effects, seed=seed, jobs=jobs, progress=part(progress, 0.0, 0.5))
    asked = of_diagnosis(found.to_dict())
    return advise(
        dataset, asked, effects=effects, menu=menu, pause=pause, jobs=jobs,
        progress=part(progress, 0.5, 0.5),
    )  # fmt: skip


def advise(
    dataset: Dataset,
    question: Question,
    *,
    effects: Mapping[str, Effect] | None = None,
    menu: Menu | None = None,
    pause: float = PAUSE,
    problem: Problem | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Plan:
    """Rank calibrations and runs by what they would do for a question.

    Args:
        dataset: with its trials.
        question: rivals to separate, or causes to see.
        effects: causes by name; None: the shipped catalogue.
        menu: of runs.
        pause: before a run, counted with it [s].
        problem: of the nominal model with its noise; None: white noise as the dataset states it, else estimated.
        jobs: threads; None: one a processor.
        progress: told what is being done.

    Raises:
        UnknownNameError: no such cause.
        InputError: a cause that the dataset cannot show, or a pause below 0.
    """
    if not 0.0 <= pause < np.inf:
        raise InputError(f"a pause of {pause:g} s, expected 0 s or more")
    causes = _causes(dataset, question, dict(catalogue() if effects is None else effects))
    question = replace(question, names=tuple(cause.name for cause in causes))
    runs = (menu or Menu()).runs(dataset)
    unknown = problem is None and dataset.noise is None
    start = baseline(dataset, jobs) if problem is None else problem
    ranked: tuple[Option, ...]
    if question.purpose == "separate":
        rivals = fit_rivals(start, causes, question.starts, progress)
        rivals = with_noise_of_the_best(rivals) if unknown else rivals
        good = all(one.fit.status == "converged" for one in rivals)
        progress("trying the runs of the menu", 0.5)
        ranked = (*_calibrations(causes, d := distances(rivals, runs)), *separating(d, causes, runs, pause))
    else:
        progress("fitting the nominal model", 0.1)
        nominal = fit(start, tolerance=1e-6)
        if unknown:
            start = replace(start, noise=estimate(start.raw(nominal.x), lost=len(nominal.x) / 3.0))
            nominal = fit(start, nominal.x, tolerance=1e-6)
        good = nominal.status == "converged"
        progress("trying the runs of the menu", 0.5)
        ranked = _showing(visibility(start, nominal, causes, runs), runs, pause)
    progress("done", 1.0)
    status: Literal["ok", "fit_not_converged", "nothing_to_offer"] = "ok" if good else "fit_not_converged"
    return Plan(
        dataset=dataset.name,
        question=question,
        options=ranked,
        status=status if ranked else "nothing_to_offer",
        message=message(question, ranked),
        remarks=_remarks(dataset, ranked),
    )


def _causes(dataset: Dataset, question: Question, known: dict[str, Effect]) -> tuple[Effect, ...]:
    if not question.names:
        return tuple(effect for effect in known.values() if not effect.not_applicable(dataset))
    found = tuple(find(name, known) for name in question.names)
    for effect in found:
        if reason := effect.not_applicable(dataset):
            raise InputError(f"{effect.name}: cannot be asked of this dataset: {reason}; leave it out")
    return found


def separating(d: Distances, rivals: Sequence[Effect], runs: Sequence[Run], pause: float) -> list[Option]:
    """Rank runs: the largest, over runs, of the smallest gain of lambda of any pair a second."""
    options = []
    for i, run in enumerate(runs):
        if not d.possible(i):
            continue
        pairs = tuple(_pair(d, a.name, b.name, i) for a, b in combinations(rivals, 2))
        seconds = run.seconds + pause
        worth = min(pair.after - pair.now for pair in pairs) / seconds
        options.append(Option("run", run.name, run.about, seconds, pairs, worth, run))
    return sorted(options, key=lambda option: -option.worth)


def _pair(d: Distances, a: str, b: str, run: int | None) -> Pair:
    """Return what a run does for a pair; lambda of the truth for which it is smaller."""
    now = d.lambdas(a, b), d.lambdas(b, a)
    after = now if run is None else (d.lambdas(a, b, run), d.lambdas(b, a, run))
    margin = d.sse[b] - d.sse[a]
    gains = d.gain(a, b, run), d.gain(b, a, run)
    return Pair(a, b, min(now), min(after), chance(margin, (NONE, NONE)), chance(margin, gains))


def _calibrations(rivals: Sequence[Effect], d: Distances) -> list[Option]:
    """Calibrations that settle a pair, those that settle most first: no swimming, and no doubt behind them."""
    options = []
    for calibration, measured in settled(rivals).items():
        names = {one.name for one in measured}
        pairs = [_pair(d, a.name, b.name, None) for a, b in combinations(rivals, 2)]
        done = tuple(
            replace(p, after=np.inf, chance_after=1.0, settled=True) if names & {p.first, p.second} else p
            for p in pairs
        )
        worth = float(sum(p.settled for p in done))
        about = f"{calibration.about}: measures {', '.join(sorted(names))} directly"
        options.append(Option("calibration", calibration.name, about, 0.0, done, worth))
    return sorted(options, key=lambda option: -option.worth)


def _showing(v: Visibility, runs: Sequence[Run], pause: float) -> tuple[Option, ...]:
    """Rank runs: the largest, over runs, of the smallest -log of the shrinking of any visible size a second."""
    now = {cause: v.sizes(cause) for cause in v.amplitudes}
    best = {
        cause: min(sizes, key=lambda name: sizes[name] / next(p.scale for p in v.amplitudes[cause] if p.name == name))
        for cause, sizes in now.items()
        if np.all(np.isfinite(list(sizes.values())))
    }
    options = []
    for i, run in enumerate(runs):
        if v.new[i] is None or not best:
            continue
        pairs = tuple(
            Pair(name, "", now[cause][name], v.sizes(cause, i)[name], np.nan, np.nan) for cause, name in best.items()
        )
        seconds = run.seconds + pause
        worth = min(float(np.log(pair.now / pair.after)) for pair in pairs) / seconds
        options.append(Option("run", run.name, run.about, seconds, pairs, worth, run))
    return tuple(sorted(options, key=lambda option: -option.worth))


def _remarks(dataset: Dataset, options: Sequence[Option]) -> tuple[str, ...]:
    remarks = []
    if dataset.fish.cpg is None:
        remarks.append("the fish has no CPG: the menu has repeats of its trials only; name a fish with [cpg] for more")
    if any(option.run is not None and option.run.repeat for option in options):
        remarks.append("repeats measure the noise; what they do here is in the table")
    return tuple(remarks)
