"""The verdict: one rule, and its sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mjfish.diagnose.refit import Refit
from mjfish.diagnose.result import Verdict
from mjfish.diagnose.select import Standing

#: Something is wrong where the nominal model's p value is below this: two false alarms in a hundred.
ALARM = 0.02


@dataclass(frozen=True)
class Ruling:
    """A verdict with the names it rests on: the cause, or the rivals."""

    verdict: Verdict
    names: tuple[str, ...]
    message: str


def rule(
    p_wrong: float, refits: Mapping[str, Refit], standings: Mapping[str, Standing], held_out: Mapping[str, float | None]
) -> Ruling:
    """Decide.

    - the nominal model is not contradicted: ``nothing_wrong``;
    - causes stay that the data cannot tell from the best, fit, and do not lose on held-out trials: one is ``named``,
      several ``cannot_tell``;
    - none stays: ``unexplained``.

    Args:
        p_wrong: p value of the nominal model.
        refits: every candidate fitted together with the coefficients.
        standings: of the candidates.
        held_out: log-likelihood gained on held-out trials, None where there are none.
    """
    if p_wrong >= ALARM:
        return Ruling(
            "nothing_wrong", (), f"Nothing wrong was found: the nominal model fits to within noise (p = {p_wrong:.2g})."
        )
    close = [name for name, standing in standings.items() if standing.in_set]
    staying = sorted(
        (name for name in close if standings[name].fits and not _loses(held_out.get(name))),
        key=lambda name: -refits[name].gain,
    )
    if len(staying) == 1:
        name = staying[0]
        return Ruling("named", (name,), f"The cause is {name}: {refits[name].effect.summary}.")
    if staying:
        listed = " or ".join(staying)
        return Ruling("cannot_tell", tuple(staying), f"Something is wrong, but these data cannot tell {listed} apart.")
    best = max(refits, key=lambda name: refits[name].gain) if refits else "none"
    return Ruling(
        "unexplained",
        (),
        f"Something is wrong that no known cause explains; the closest, {best}, {_why(best, standings, held_out)}.",
    )


def _loses(gained: float | None) -> bool:
    return gained is not None and gained <= 0.0


def _why(best: str, standings: Mapping[str, Standing], held_out: Mapping[str, float | None]) -> str:
    standing = standings.get(best)
    if standing is not None and not standing.fits:
        return "leaves a systematic residual"
    if _loses(held_out.get(best)):
        return "does not hold on the held-out trials"
    return "does not hold"
