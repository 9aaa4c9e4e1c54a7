"""A refit: causes fitted together with the coefficients, and what that explains.

Refits are made side by side, on other processors and machines where they are given, and kept where a folder is given.
A refit is sent and kept as what it found; its residual and derivatives follow from that to the last bit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.failures import Failure, Parts, attempted, failed, joined, note, noted
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem
from mjfish.estimation.fit import End, fit_at, fit_or_raise
from mjfish.estimation.marginal_likelihood import effective_degrees_of_freedom
from mjfish.execution import completed, execution, in_order
from mjfish.execution.checkpoint import Checkpoint
from mjfish.files.plain_data import plain, restored
from mjfish.numerics.block_angular import span
from mjfish.numerics.sized_cache import always
from mjfish.parameters import Parameter

#: Relative change of the sum of squares at which a refit stops.
TOLERANCE = 1e-5
#: A refit that was stopped gains at most so many times what its next step promises: in 20 cases, 1.2 to 2 times.
_AT_MOST = 2.0


@dataclass(frozen=True, eq=False)
class Refit:
    """Causes fitted together with the coefficients.

    Attributes:
        effects: the causes, the last one added last.
        problem: of the extended model.
        fit: its result.
        gain: fall of the sum of squares against the fit of the nominal model, LR.
    """

    effects: tuple[Effect, ...]
    problem: Problem
    fit: Fit
    gain: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(effect.name for effect in self.effects)

    @property
    def learned(self) -> bool:
        """Whether the form of a cause is learned."""
        return any(effect.learned for effect in self.effects)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names of the mechanisms of the causes, sorted."""
        return tuple(sorted({effect.mechanism for effect in self.effects}))

    @functools.cached_property
    def degrees_of_freedom(self) -> float:
        """Number of parameters that the causes add; a shape to which the fit does not respond is not counted.

        Of a learned form, the effective number: priors take the place of data.
        """
        responds = {p.name for p, own in zip(self.fit.parameters, self.fit.lengths, strict=True) if own > 0.0}
        formulas = (p for effect in self.effects if not effect.learned for p in effect.parameters)
        learned = [p.name for effect in self.effects if effect.learned for p in effect.parameters]
        plain = sum(not p.shape or p.name in responds for p in formulas)
        return plain + effective_degrees_of_freedom(self.problem, self.fit, learned) if learned else plain

    @functools.cached_property
    def promise(self) -> float:
        """What a step more may gain where the fit was stopped: the part of the residual that its derivatives span."""
        if self.fit.status != "stopped":
            return 0.0
        return span(self.fit.jacobian.chosen(~self.fit.at_bound)).explained(self.fit.residual)

    @property
    def reach(self) -> float:
        """What it may gain once it is followed to its optimum."""
        return self.gain + _AT_MOST * self.promise

    @property
    def adjusted(self) -> float:
        """The gain less two for every parameter beyond the first: what sets of different size compare on."""
        return self.gain - 2.0 * (self.degrees_of_freedom - 1)

    def moved(self, fit: Fit, problem: Problem | None = None) -> Refit:
        """Return the same causes at another fit, of another problem where one is given."""
        return replace(self, problem=problem or self.problem, fit=fit, gain=self.gain + self.fit.sse - fit.sse)

    def less(self, out: Effect) -> Refit:
        """Refit without one of several causes, from where the others and the coefficients are."""
        kept = tuple(effect for effect in self.effects if effect.name != out.name)
        left = tuple(effect for effect in self.problem.model.effects if effect.name != out.name)
        problem = replace(self.problem, model=replace(self.problem.model, effects=left))
        here = fit_or_raise(problem, problem.start(self.fit.values), tolerance=TOLERANCE)
        return Refit(kept, problem, here, self.gain + self.fit.sse - here.sse)


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
        if here.checkpoint is None
        else [*here.checkpoint.step([" ".join([*names, *sorted(parts.failures)]) for names, _ in left])]
    )
    found = [None if file is None else Checkpoint.read(file) for file in files]
    rest = [place for place, known in enumerate(found) if known is None]
    recorded = here.checkpoint is not None or here.executor is not None
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
                    Checkpoint.write(file, result)
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
        return Failure(
            joined(names), f"its refit {refit.fit.status}: {refit.fit.message}; narrow its bounds, or leave it out"
        )
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
    declared = restored(dict[str, Parameter], record["declared"])
    own = {name: record[name] for name in _OWN}
    problem = replace(start, model=model, declared={**start.declared, **declared}, **own)
    return Refit(problem.causes, problem, fit_at(problem, restored(End, record["end"])), record["gain"])
