"""Simple guessers beside the diagnosis: what an answer is worth shows only against answers that cost nothing.

Each names one cause and never abstains; what they know they take from the same data.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from studies.battery.answers import Judged
from studies.battery.figures import TOLD_APART, Figure, apart, proportion

Guess = Callable[[Judged], str | None]


def guessers(cases: Sequence[Judged]) -> dict[str, Guess]:
    """Return guessers by name; those that look answers up learn their table from all other cases."""
    singles = [c for c in cases if c.truth.kind == "one"]
    return {
        "most frequent cause": lambda case: _most_frequent([c for c in singles if c is not case]),
        "largest channel, looked up": lambda case: _most_frequent(
            [c for c in singles if c is not case and c.answer["where"] == case.answer["where"]]
        ),
        "refit with the lowest error": lambda case: _lowest(case, "error"),
        "refit with the lowest held-out error": lambda case: _lowest(case, "held_out_error"),
        "sparse regression on differentiated velocities": lambda case: case.answer.get("sparse"),
        "largest score": lambda case: max(case.answer["candidates"], key=lambda one: one["score"])["name"],
    }


def compared(cases: Sequence[Judged]) -> list[Figure]:
    """Return how often each guesser, and the diagnosis, is right on single causes that can be told apart."""
    clear = [c for c in cases if c.truth.kind == "one" and apart(c) >= TOLD_APART]
    rows = [proportion("the diagnosis", "", (c.right for c in clear), lambda _: True)]
    for name, guess in guessers(cases).items():
        rows.append(proportion(name, "", (guess(c) == c.truth.causes[0] for c in clear), lambda _: True))
    return rows


def _most_frequent(cases: Sequence[Judged]) -> str | None:
    counted = Counter(c.truth.causes[0] for c in cases).most_common(1)
    return counted[0][0] if counted else None


def _lowest(case: Judged, key: str) -> str | None:
    known = [one for one in case.answer["candidates"] if one[key] is not None]
    return min(known, key=lambda one: one[key])["name"] if known else None
