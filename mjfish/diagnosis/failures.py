"""What fails in a diagnosis: a candidate, or another part of the work. The rest goes on, and nothing is claimed.

A candidate fails where its effect raises, its refit diverges or ends with an error, or takes longer than it may. It is
left out from there on, as any other part that fails. With a failed part the verdict is neither ``named`` nor
``nothing_wrong``: what was not tried may be the cause.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TypeVar

from mjfish.effects import Effect
from mjfish.errors import NUMERIC, MjfishError, WorkerError, reason_of
from mjfish.estimation import Fit
from mjfish.execution import execution, limited

T = TypeVar("T")

#: The part of a diagnosis without which there is no other.
NOMINAL = "the fit of the nominal model"
#: Parts, or reasons, that a line lists where there are more.
LISTED = 3


class PartFailedError(Exception):
    """A part without which there is nothing to go on with: its arguments are its name and the reason."""


@dataclass(frozen=True)
class Failure:
    """Why a candidate failed, or a set of them."""

    name: str
    reason: str


@dataclass
class Parts:
    """The parts of a diagnosis that failed.

    Attributes:
        failures: the reasons, by part.
    """

    failures: dict[str, str] = field(default_factory=dict)

    def run(self, part: str, make: Callable[[], T], otherwise: T) -> T:
        """Return what `make` returns. Where an effect raises or numbers go wrong, note that and return the other."""
        try:
            return make()
        except PartFailedError:
            raise
        except Exception as error:
            name = raised_in(error)
            if not name and (isinstance(error, MjfishError) or not isinstance(error, NUMERIC)):
                raise
            self.failures.update(dict.fromkeys([name or part, part], reason_of(error)))
            return otherwise


#: Of the diagnosis that this thread works on.
_PARTS: ContextVar[Parts] = ContextVar("parts")


@contextmanager
def noting(parts: Parts) -> Iterator[Parts]:
    """Note candidates that fail in the block among these parts, and yield them."""
    token = _PARTS.set(parts)
    try:
        yield parts
    finally:
        _PARTS.reset(token)


def noted() -> Parts | None:
    """Return the parts of the diagnosis that this thread works on; None where it works on none."""
    return _PARTS.get(None)


def note(failure: Failure) -> None:
    """Note that a candidate failed, and why it did first."""
    _PARTS.get().failures.setdefault(failure.name, failure.reason)


def failed(names: Sequence[str]) -> bool:
    """Return whether a set of candidates failed, or one of them alone."""
    parts = noted()
    return parts is not None and not parts.failures.keys().isdisjoint([*names, joined(names)])


def joined(names: Sequence[str]) -> str:
    """Return what a set of candidates is called where it fails."""
    return " with ".join(sorted(names))


def attempted(names: Sequence[str], make: Callable[[], T]) -> T | Failure:
    """Return what `make` returns, or why that failed: by the candidate that raised, else by the name of the set.

    Raises:
        WorkerError: a worker is gone.
    """
    try:
        with limited(execution().limit):
            return make()
    except (PartFailedError, WorkerError):
        raise
    except Exception as error:
        raised = raised_in(error)
        return Failure(raised if raised in names else joined(names), reason_of(error))


def tried(names: Sequence[str], make: Callable[[], T], otherwise: T) -> T:
    """Return what `make` returns. Where it fails in a diagnosis, note the candidates as failed and return the other."""
    made = attempted(names, make) if noted() else make()
    if not isinstance(made, Failure):
        return made
    note(made)
    return otherwise


def raised_in(error: Exception) -> str:
    """Return the name of the effect one of whose methods raised; empty where none did."""
    owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(error.__traceback__))
    return next((owner.name for owner in owners if isinstance(owner, Effect)), "")


def sound(part: str, found: Fit) -> Fit:
    """Return a fit without which there is nothing to go on with.

    Raises:
        PartFailedError: it diverged or failed.
    """
    if found.lost:
        raise PartFailedError(part, f"it {found.status}: {found.message}")
    return found


def finite(part: str, **numbers: float) -> None:
    """Refuse numbers that a verdict rests on where one is none: a comparison with it would be false, and say nothing.

    Raises:
        PartFailedError: one is not a number; the first is named.
    """
    for name, number in numbers.items():
        if math.isnan(number):
            raise PartFailedError(part, f"its statistic '{name}' is no number")


def folded(failures: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return what failed and why, parts that failed for the same reason together, with their count."""
    alike: dict[str, list[str]] = {}
    for part, reason in failures.items():
        alike.setdefault(reason, []).append(part)
    return [
        (", ".join(parts[:LISTED]) + (f" and others ({len(parts)} in all)" if len(parts) > LISTED else ""), reason)
        for reason, parts in alike.items()
    ]
