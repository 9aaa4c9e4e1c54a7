"""Refits side by side, on other processors and machines where they are given, and kept where a folder is given.

A refit is sent and kept as what it found; its residual and derivatives follow from that to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.failures import Failure, Parts, attempted, failed, joined, note, noted
from mjfish.diagnosis.refit_result import Refit
from mjfish.effects.effect import Effect
from mjfish.estimation import Problem
from mjfish.estimation.fit import End, fit_at
from mjfish.execution import completed, execution, in_order
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

    One that fails is noted, and left out; so is one whose cause failed before.

    Args:
        make: what it returns must not depend on where it runs.
        effects: the causes.
        evidence: of the model that they extend.
        given: what else each is made of, if anything.
    """
    tasks = list(zip(effects, given, strict=True)) if given is not None else [(effect,) for effect in effects]
    named = [[*(cause.name for cause in evidence.problem.causes), effect.name] for effect in effects]
    return _side_by_side(partial(make, evidence), evidence.problem, tasks, named)


def followed(
    make: Callable[[Refit], Refit], refits: Sequence[Refit], names: Sequence[Sequence[str]] | None = None
) -> Iterator[Refit]:
    """Yield the refit that `make` makes of each of these, in their order; see `extended`.

    Args:
        make: what it returns must not depend on where it runs.
        refits: that go on.
        names: of the causes that each has then; None: those that it has.
    """
    named = [refit.names for refit in refits] if names is None else names
    return _side_by_side(make, None, [(refit,) for refit in refits], named)


def _side_by_side(
    make: Callable[..., Refit],
    problem: Problem | None,
    tasks: Sequence[tuple[Any, ...]],
    named: Sequence[Sequence[str]],
) -> Iterator[Refit]:
    """Yield the refits of those tasks that do not fail.

    Args:
        make: makes a refit of a task.
        problem: that causes extend; None: the tasks are refits that go on.
        tasks: what they are.
        named: the names of the causes of each refit.
    """
    here, parts = execution(), noted() or Parts()
    left = [(names, task) for names, task in zip(named, tasks, strict=True) if not failed(names)]
    files = (
        [None] * len(left)
        if here.kept is None
        else [*here.kept.step([" ".join([*names, *sorted(parts.failures)]) for names, _ in left])]
    )
    found = [None if file is None else Kept.read(file) for file in files]
    rest = [place for place, known in enumerate(found) if known is None]
    recorded = here.kept is not None or here.executor is not None
    function: Callable[[Any], Any] = partial(_attempted, make)
    if recorded:
        function = partial(_recorded, function, problem)

    def made() -> Generator[tuple[int, Callable[[], Any]]]:
        yield from ((place, always(known)) for place, known in enumerate(found) if known is not None)
        for k, get in completed(function, [left[place] for place in rest]):
            if (file := files[rest[k]]) is None:
                yield rest[k], get
            else:
                result = get()
                if not isinstance(result, Failure):
                    Kept.write(file, result)
                yield rest[k], always(result)

    for k, ((_, task), result) in enumerate(zip(left, in_order(made()), strict=True), 1):
        here.meter.refitted(len(left) - k)
        if isinstance(result, Failure):
            note(result)
        else:
            yield _restored(result, *_origin(task[0], problem)) if recorded else result


def _origin(task: Begun, problem: Problem | None) -> tuple[Problem, dict[str, Effect]]:
    """Return the problem that a task begins with, and the effects that its refit may have by name."""
    start = task.problem if isinstance(task, Refit) else problem
    assert start is not None  # noqa: S101 - of a cause that extends it
    effects = {effect.name: effect for effect in start.model.effects}
    return start, {**effects, task.name: task} if isinstance(task, Effect) else effects


#: What the problem of a refit may have of its own, beside effects, step and declarations.
_OWN = ("slope_step", "prior_sds")


def _attempted(make: Callable[..., Refit], named: tuple[Sequence[str], tuple[Any, ...]]) -> Refit | Failure:
    names, task = named
    refit = attempted(names, lambda: make(*task))
    if isinstance(refit, Refit) and refit.fit.lost:
        return Failure(joined(names), f"its refit {refit.fit.status}: {refit.fit.message}")
    return refit


def _recorded(
    make: Callable[..., Refit | Failure], problem: Problem | None, named: tuple[Sequence[str], tuple[Any, ...]]
) -> dict[str, Any] | Failure:
    """Return what a refit found as plain data, or why it failed."""
    refit = make(named)
    if isinstance(refit, Failure):
        return refit
    start, found = _origin(named[1][0], problem)[0], refit.fit
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
