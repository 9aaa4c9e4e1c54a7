"""Refits side by side, on other processors and machines where they are given, and kept where a folder is given.

A refit is sent and kept as what it found; its residual and derivatives follow from that to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.failures import Failure, attempted, candidate_limit, unfailing
from mjfish.diagnosis.refit_result import Refit
from mjfish.effects.effect import Effect
from mjfish.estimation import Problem
from mjfish.estimation.fit import End, fit_at
from mjfish.executors import completed, in_order
from mjfish.kept import Kept
from mjfish.parameter import Parameter
from mjfish.serialise import plain
from mjfish.sized_cache import always

#: A cause that is added to a model, or a refit that is followed.
Begun = Effect | Refit


def extended(
    make: Callable[..., Refit], effects: Sequence[Effect], evidence: Evidence, given: Sequence[Any] | None = None
) -> Iterator[Refit]:
    """Yield the refit that `make` makes of an evidence, each cause and what is given for it, in their order.

    Args:
        make: what it returns must not depend on where it runs.
        effects: the causes.
        evidence: of the model that they extend.
        given: what else each is made of, if anything.
    """
    tasks = list(zip(effects, given, strict=True)) if given is not None else [(effect,) for effect in effects]
    return _side_by_side(_extend, make, evidence, tasks)


def followed(make: Callable[[Refit], Refit], refits: Sequence[Refit]) -> Iterator[Refit]:
    """Yield the refit that `make` makes of each of these, in their order; see `extended`."""
    return _side_by_side(_follow, make, refits[0], [(refit,) for refit in refits]) if refits else iter(())


def _extend(make: Callable[..., Refit], evidence: Evidence, task: tuple[Any, ...]) -> Refit:
    return make(evidence, *task)


def _follow(make: Callable[..., Refit], first: Refit, task: tuple[Any, ...]) -> Refit:
    (refit,) = task
    own = first.problem  # as a worker has it: no executor, no folder
    return make(replace(refit, problem=replace(refit.problem, jobs=own.jobs, executor=own.executor, kept=own.kept)))


def _side_by_side(
    call: Callable[..., Refit], make: Callable[..., Refit], first: Evidence | Refit, tasks: Sequence[tuple[Any, ...]]
) -> Iterator[Refit]:
    """Yield the refits; the problem of `first` has threads, executor and folder, which each refit gets back.

    Raises:
        CandidatesFailedError: some failed; raised once all were tried.
    """
    problem, begun = first.problem, [task[0] for task in tasks]
    kept, executor = problem.kept, problem.executor
    files = [None] * len(tasks) if kept is None else [*kept.step([_name(task) for task in begun])]
    found = [None if file is None else Kept.read(file) for file in files]
    rest = [place for place, known in enumerate(found) if known is None]
    worker: Any = replace(first, problem=problem.alone)
    recorded = kept is not None or executor is not None
    function: Callable[[tuple[Any, ...]], Any] = partial(_attempted, partial(call, make, worker), candidate_limit())
    if recorded:
        function = partial(_recorded, function, problem.alone)

    def made() -> Iterator[tuple[int, Callable[[], Any]]]:
        yield from ((place, always(known)) for place, known in enumerate(found) if known is not None)
        for k, get in completed(function, [tasks[place] for place in rest], problem.jobs, executor):
            if (file := files[rest[k]]) is None:
                yield rest[k], get
            else:
                result = get()
                if not isinstance(result, Failure):
                    Kept.write(file, result)
                yield rest[k], always(result)

    results = in_order(made())
    for task in begun:
        result = next(results)
        if isinstance(result, Failure):
            unfailing([result, *results])
        refit = _restored(result, *_origin(task, problem)) if recorded else result
        own = replace(refit.problem, jobs=problem.jobs, executor=executor, kept=kept)
        yield replace(refit, problem=own)


def _name(task: Begun) -> str:
    return task.name if isinstance(task, Effect) else " ".join(task.names)


def _origin(task: Begun, problem: Problem) -> tuple[Problem, dict[str, Effect]]:
    """Return the problem that a task begins with, and the effects that its refit may have by name."""
    start = problem if isinstance(task, Effect) else task.problem
    effects = {effect.name: effect for effect in start.model.effects}
    return start, {**effects, task.name: task} if isinstance(task, Effect) else effects


#: What the problem of a refit may have of its own, beside effects, step and declarations.
_OWN = ("slope_step", "prior_sds")


def _attempted(make: Callable[..., Refit], limit: float, task: tuple[Any, ...]) -> Refit | Failure:
    return attempted(lambda _: make(task), task[0], limit)


def _recorded(
    make: Callable[..., Refit | Failure], problem: Problem, task: tuple[Any, ...]
) -> dict[str, Any] | Failure:
    """Return what a refit found as plain data, or why it failed."""
    refit = make(task)
    if isinstance(refit, Failure):
        return refit
    start, found = _origin(task[0], problem)[0], refit.fit
    new = {name: p for name, p in refit.problem.declared.items() if start.declared.get(name) != p}
    return {
        "effects": [effect.name for effect in refit.problem.model.effects],
        "step": refit.problem.model.step,
        "declared": {name: plain(p) for name, p in new.items()},
        **{name: plain(getattr(refit.problem, name)) for name in _OWN},
        "gain": refit.gain,
        "end": {entry.name: plain(getattr(found, entry.name)) for entry in fields(End)},
        "parameters": found.values,
    }


def _restored(record: dict[str, Any], start: Problem, effects: dict[str, Effect]) -> Refit:
    """Return the refit of a record, to the last bit."""
    model = replace(start.model, effects=tuple(effects[name] for name in record["effects"]), step=record["step"])
    declared = {name: Parameter(**own) for name, own in record["declared"].items()}
    own = {name: record[name] for name in _OWN}
    problem = replace(start, model=model, declared={**start.declared, **declared}, **own)
    end = record["end"]
    arrays = {name: np.array(end[name]) for name in ("x", "ended", "at_bound")}
    cost = np.nan if end["cost"] is None else end["cost"]
    return Refit(problem.causes, problem, fit_at(problem, End(**{**end, **arrays, "cost": cost})), record["gain"])
