"""Which of the imported trials are fitted and which are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mjfish.data import Role, Trial
from mjfish.errors import InputError, UnknownNameError


def assign(
    trials: Sequence[tuple[str, Trial]], held_out: Sequence[str], doubtful: Sequence[bool] = ()
) -> tuple[Trial, ...]:
    """Return the trials with roles.

    Args:
        trials: each with the name of its file's run.
        held_out: names of trials or runs not to be fitted.
        doubtful: per trial, whether something had to be left out of it; where nothing is named, those are held out if
            there are others.

    Raises:
        UnknownNameError: `held_out` names nothing.
        InputError: nothing is left to fit.
    """
    known = {name for run, trial in trials for name in (run, trial.name)}
    for name in held_out:
        if name not in known:
            raise UnknownNameError("trial to hold out", name, known)
    if held_out:
        out = [run in held_out or trial.name in held_out for run, trial in trials]
        if all(out):
            raise InputError("all trials are held out, expected one or more to fit; name fewer of them to hold out")
    else:
        out = list(doubtful) or [False] * len(trials)
    roles: list[Role | None] = [None if not any(out) or all(out) else "held_out" if apart else "fit" for apart in out]
    return tuple(replace(trial, role=role) for (_, trial), role in zip(trials, roles, strict=True))


def distinct(names: Sequence[str], places: Sequence[object]) -> None:
    """Refuse two files whose runs share a name."""
    for index, name in enumerate(names):
        if name in names[:index]:
            raise InputError(f"{places[index]}: its trial '{name}' has the name of another file's; rename one file")
