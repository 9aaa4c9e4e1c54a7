"""What fails in a diagnosis: a candidate, or another part of the work. The rest goes on, and nothing is claimed.

A candidate fails where its effect raises, its refit diverges or ends with an error, or takes longer than it may. The
diagnosis then begins anew without it, so that the others are compared as if it were not on the list. Any other part
that fails is left out. With a failed part the verdict is neither ``named`` nor ``nothing_wrong``: what was not tried
may be the cause.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, TypeVar

from mjfish.effects import Effect
from mjfish.errors import NUMERIC, MjfishError, reason_of
from mjfish.estimation import Fit
from mjfish.estimation.time_limit import PastLimitError, limited

T = TypeVar("T")

#: The part of a diagnosis without which there is no other.
NOMINAL = "the fit of the nominal model"
#: Seconds that one try of a candidate may take.
_limit: ContextVar[float] = ContextVar("limit", default=math.inf)


@contextmanager
def candidates_limited(seconds: float | None) -> Iterator[None]:
    """Let no try of a candidate that this thread begins take longer; None: however long."""
    token = _limit.set(math.inf if seconds is None else seconds)
    try:
        yield
    finally:
        _limit.reset(token)


def candidate_limit() -> float:
    """Return the seconds that one try of a candidate may take."""
    return _limit.get()


class PartFailedError(Exception):
    """A part without which there is nothing to go on with: its name and the reason."""

    def __init__(self, part: str, reason: str) -> None:
        super().__init__(part, reason)
        self.part, self.reason = part, reason


class CandidatesFailedError(Exception):
    """Candidates that cannot be tried, with the reasons by name."""

    def __init__(self, reasons: Mapping[str, str]) -> None:
        super().__init__(dict(reasons))
        self.reasons = dict(reasons)


@dataclass(frozen=True)
class Failure:
    """Why a candidate failed."""

    name: str
    reason: str


def attempted(make: Callable[[Any], T], task: Any, limit: float | None = None) -> T | Failure:
    """Return what `make` makes of a candidate or of a refit, or why that failed.

    Args:
        make: returns what has a `fit`.
        task: an effect, or a refit whose last cause is tried.
        limit: seconds that it may take; None: those of `candidates_limited` in this thread.
    """
    limit = _limit.get() if limit is None else limit
    name = task.name if isinstance(task, Effect) else task.names[-1]
    try:
        with limited(limit):
            made = make(task)
    except Exception as error:
        return Failure(name, _said(error, limit))
    fit: Fit = made.fit  # type: ignore[attr-defined]
    return Failure(name, f"its refit {fit.status}: {fit.message}") if fit.lost else made


def unfailing(made: Iterable[T | Failure]) -> list[T]:
    """Return what was made, where nothing failed.

    Raises:
        CandidatesFailedError: something did.
    """
    every = [*made]
    if reasons := {one.name: one.reason for one in every if isinstance(one, Failure)}:
        raise CandidatesFailedError(reasons)
    return [one for one in every if not isinstance(one, Failure)]


def _said(error: Exception, limit: float) -> str:
    if isinstance(error, PastLimitError):
        return f"it took longer than the limit of {limit:g} s"
    return reason_of(error)


def raised_in(error: Exception) -> str:
    """Return the name of the effect one of whose methods raised; empty where none did."""
    owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(error.__traceback__))
    return next((owner.name for owner in owners if isinstance(owner, Effect)), "")


@contextmanager
def blamed(name: str) -> Iterator[None]:
    """Take what is raised inside for a failure of the effect that raised it, else of the candidate of this name."""
    limit = _limit.get()
    try:
        with limited(limit):
            yield
    except (CandidatesFailedError, PartFailedError):
        raise
    except Exception as error:
        raise CandidatesFailedError({raised_in(error) or name: _said(error, limit)}) from error


def sound(part: str, found: Fit) -> Fit:
    """Return a fit without which there is nothing to go on with.

    Raises:
        PartFailedError: it diverged or failed.
    """
    if found.lost:
        raise PartFailedError(part, f"it {found.status}: {found.message}")
    return found


def finite(part: str, *numbers: float) -> None:
    """Refuse numbers that a verdict rests on where one is none: a comparison with it would be false, and say nothing.

    Raises:
        PartFailedError: one is not a number.
    """
    if any(math.isnan(number) for number in numbers):
        raise PartFailedError(part, "a statistic is no number")


@dataclass
class Parts:
    """The parts of a diagnosis that failed.

    Attributes:
        failures: the reasons, by part.
    """

    failures: dict[str, str] = field(default_factory=dict)

    def run(self, part: str, make: Callable[[], T], otherwise: T) -> T:
        """Return what `make` returns; where numbers go wrong in it note the failure, and return the other.

        Raises:
            CandidatesFailedError: an effect raised.
        """
        try:
            return make()
        except (CandidatesFailedError, PartFailedError):
            raise
        except Exception as error:
            if name := raised_in(error):
                raise CandidatesFailedError({name: reason_of(error)}) from error
            if isinstance(error, MjfishError) or not isinstance(error, NUMERIC):
                raise
            self.failures[part] = reason_of(error)
            return otherwise
