"""The study: the ten modes with lambda*, with fitted numbers, and with one reason after the other."""

from __future__ import annotations

import functools
import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mjfish.drive import modes
from mjfish.errors import InputError
from mjfish.execution import executing, mapped
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from studies.table_iv.misfit import STEP, Fitted, RangeProblem
from studies.table_iv.ranges import Ranges, published, trials
from studies.table_iv.reasons import UNIT, Reason, reasons
from studies.table_iv.result import Account, Fits, Held, PaperComparison

#: Own starts of a fit of the coefficients, with a reason beside them, of a reason alone.
_STARTS, _BESIDE, _ALONE = 3, 1, 2
#: Units of beta psi at which the coefficients are fitted [deg].
_UNITS = (0.02, 0.03, 0.04, 0.06, 0.08, 0.09, 0.1)
_UNIT = UNIT.parameters[0].name


class _Study:
    """Fits of one fish to one set of ranges."""

    def __init__(self, fish: Fish, measured: FloatArray, names: Sequence[str], seed: int, unit: float) -> None:
        self.fish, self.measured, self.seed, self.unit = fish, measured, seed, unit
        self.trials = trials(names)

    def problem(
        self, *added: Reason, coefficients: bool = True, fixed: Mapping[str, float] | None = None, step: float = STEP
    ) -> RangeProblem:
        """Return what is fitted where `added` reasons are allowed for, without the parameters that are `fixed`."""
        model = Model(self.fish, tuple(effect for reason in added for effect in reason.effects), step=step)
        free = [*(self.fish.parameters if coefficients else ()), *(p for reason in added for p in reason.parameters)]
        free = [p for p in free if p.name not in (fixed or {})]
        return RangeProblem(model, self.trials, self.measured, tuple(free), fixed or {})

    def fit(self, posed: RangeProblem, own: int, known: Fitted | None = None) -> Fitted:
        """Fit from `own` starts; where these find nothing better, from the optimum `known` of a smaller problem.

        What is new in this problem is at its null value there, so that no fit is worse than that of the smaller one.
        """
        found = posed.fit(posed.starts(own, self.seed)) if own else None
        if known is None or (found is not None and found.misfit < known.misfit):
            return found or posed.fit(posed.starts(1, self.seed))
        (declared,) = posed.starts(1, self.seed)
        inside = [known.optimum.get(name, at) for name, at in zip(posed.names, declared, strict=True)]
        null = posed.fitted(np.array([known.optimum.get(p.name, p.default) for p in posed.free]))
        outcomes = [one for one in (found, posed.fit([np.array(inside)]), null) if one is not None]
        return min(outcomes, key=lambda one: one.misfit)

    def account(self, reason: Reason, coefficients: Fitted, fitted: Fitted) -> Account:
        """Fit a reason alone, with the coefficients, and with these and the unit of beta psi."""
        alone = self.fit(self.problem(reason, coefficients=False), _ALONE)
        if reason is UNIT:
            return Account(reason, alone, fitted, None)
        beside = self.fit(self.problem(reason), _BESIDE, coefficients)
        return Account(reason, alone, beside, self.fit(self.problem(reason, UNIT), 0, fitted))

    def held(self, fitted: Fitted) -> tuple[Held, ...]:
        """Fit the coefficients with the unit held, each fit starting where the one with its neighbour ended."""
        best = self.unit * (1.0 + fitted.values[_UNIT])
        found = []
        for way in ([u for u in reversed(_UNITS) if u < best], [u for u in _UNITS if u >= best]):
            last = fitted
            for unit in way:
                posed = self.problem(UNIT, fixed={_UNIT: unit / self.unit - 1.0})
                (declared,) = posed.starts(1, self.seed)
                start = [last.values.get(name, at) for name, at in zip(posed.names, declared, strict=True)]
                last = posed.fit([np.array(start)])
                found.append(Held(unit, last.misfit, posed.ranges(last.values)[0].speed))
        return tuple(sorted(found, key=lambda one: one.unit))


def compare_paper(
    fish: Fish,
    *,
    measured: FloatArray | None = None,
    names: Sequence[str] = modes.MODES,
    fit: bool = True,
    seed: int = 0,
    jobs: int | None = None,
    tell: Callable[[float], None] | None = None,
) -> PaperComparison:
    """Compare the modes of [Yu2016], Table IV, with the ranges that were published.

    Args:
        fish: the paper's, with a CPG of four joints.
        measured: (modes, 3) ranges; None: those of the paper.
        names: of the modes.
        fit: fit coefficients, the unit of beta psi and reasons; else simulate with the fish's own numbers only.
        seed: of the starts.
        jobs: threads; the result does not depend on them. None: one a processor.
        tell: called with the share that is done.

    Raises:
        InputError: the fish has no CPG that these modes can drive, or its own numbers diverge in some.
    """
    if fish.cpg is None or fish.joints != len(modes.drive(modes.MODES[0])[0].bias):
        raise InputError(f"{fish.name}: expected a fish with a [cpg] of four joints, as the paper's; name another")
    unit = math.degrees(fish.cpg.unit)
    study = _Study(fish, published(names) if measured is None else measured, names, seed, unit)
    own = study.problem(coefficients=False, step=Model(fish).step)
    nominal = own.fitted(np.zeros(0))
    ranges = own.ranges(nominal.values)
    _finite(fish, ranges)
    fits = _fits(study, jobs or os.cpu_count() or 1, tell or (lambda _: None)) if fit else None
    return PaperComparison(fish.name, unit, tuple(names), study.measured, nominal, ranges, fits)


def _finite(fish: Fish, ranges: Sequence[Ranges]) -> None:
    """Refuse a fish whose own numbers diverge: there is nothing to compare, and nothing to fit from."""
    lost = [range_.mode for range_ in ranges if not np.all(np.isfinite(range_.whole))]
    if lost:
        raise InputError(
            f"{fish.name}: its simulation diverges in {', '.join(lost)}, expected finite ranges; check density, "
            "masses, lengths and coefficients of the fish (SI units), or name another"
        )


def _fits(study: _Study, jobs: int, tell: Callable[[float], None]) -> Fits:
    known = reasons()
    told = _Counter(3 + len(known), tell)
    first = [functools.partial(study.fit, study.problem(*added), _STARTS) for added in ((), (UNIT,))]
    coefficients, fitted = _together(first, jobs, told)
    finer = study.problem(UNIT, step=Model(study.fish).step)
    fitted = finer.fitted(np.array([fitted.values[name] for name in finer.names]), fitted.evaluations)
    rest = [functools.partial(study.account, reason, coefficients, fitted) for reason in known]
    held, *accounts = _together([functools.partial(study.held, fitted), *rest], jobs, told)
    scaled = next(account.alone for account in accounts if account.reason is UNIT)
    return Fits(
        coefficients, fitted, finer.ranges(fitted.values), scaled, finer.ranges(scaled.values), tuple(accounts), held
    )


class _Counter:
    """Tells the share of tasks that is done, from whichever thread."""

    def __init__(self, total: int, tell: Callable[[float], None]) -> None:
        self.total, self.tell, self.done, self.lock = total, tell, 0, threading.Lock()

    def __call__(self) -> None:
        with self.lock:
            self.done += 1
            self.tell(self.done / self.total)


def _together(tasks: Sequence[Callable[[], Any]], jobs: int, told: _Counter) -> list[Any]:
    """Run the tasks, which share nothing, in threads; return what they return, in their order."""

    def run(task: Callable[[], Any]) -> Any:
        outcome = task()
        told()
        return outcome

    with executing(jobs):
        return list(mapped(run, tasks))
