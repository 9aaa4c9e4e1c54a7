"""Errors: one root, leaves that are also the builtin a caller expects.

Wrong input raises one of these. A bad outcome (a rollout that diverges, a fit that does not converge) is
never an exception: it is a ``status`` on the result.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator


class MjfishError(Exception):
    """Root of all errors of mjfish; the message says what was found, what was expected and what to do.

    Example:
        >>> import mjfish
        >>> try:
        ...     mjfish.load_fish("carp")
        ... except mjfish.MjfishError as error:
        ...     print(error)
        unknown fish 'carp'; known: eth_tendon, one_joint, pike; or give the path of a fish TOML
    """


#: What solvers and optimisers raise where numbers go wrong, `numpy.linalg.LinAlgError` among them.
NUMERIC = (ArithmeticError, ValueError, RuntimeError)


class InputError(MjfishError, ValueError):
    """A file, key, row or argument is not what it must be."""


class UnwritableError(InputError):
    """A file or folder that cannot be written: no room, no permission, or no such place."""


class UnknownNameError(MjfishError, LookupError):
    """A name that is not among the known ones; the message lists those."""

    def __init__(self, kind: str, name: str, known: Iterable[str], remedy: str = "") -> None:
        listed = ", ".join(sorted(known)) or "none"
        super().__init__(f"unknown {kind} '{name}'; known: {listed}{'; ' + remedy if remedy else ''}")


class WorkerError(MjfishError, RuntimeError):
    """A worker, another process or another machine, ended without an answer."""


class ParameterError(MjfishError, ValueError):
    """A parameter outside its bounds, or given a value that is no number."""


def reason_of(error: Exception) -> str:
    """Return what an error says, in one line, with its type where that is none of mjfish's."""
    said, kind = next(iter(str(error).splitlines()), ""), type(error)
    return said if kind.__module__.startswith("mjfish.") else f"{kind.__name__}: {said}".rstrip(": ")


@contextlib.contextmanager
def system_refusals() -> Iterator[None]:
    """Make what the system says of a file that is named, such as a name that is too long, bad input."""
    try:
        yield
    except ValueError as error:
        if not str(error).startswith("embedded null"):
            raise
        raise InputError(
            "the name of a file or folder holds a character NUL, which none can have; correct it"
        ) from error
    except OSError as error:
        if error.filename is None:
            raise
        raise InputError(f"{error.filename}: {error.strerror}; give another file or folder") from error


@contextlib.contextmanager
def located(place: str) -> Iterator[None]:
    """Put `place`, a file and key, before the message of any error of mjfish raised inside; its type stays."""
    try:
        yield
    except MjfishError as error:
        error.args = (f"{place}: {error}",)
        raise
