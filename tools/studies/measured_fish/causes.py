"""What docs/real-fish.md says of the causes: which were refitted, which rank by their score, what held-out runs say."""

from __future__ import annotations

from collections.abc import Iterator

from mjfish.diagnosis import Candidate, Diagnosis, Estimate
from mjfish.effects import find

HEAD = ("cause", "fall of the sum of squares", "score", "nRMSE fitted", "nRMSE held out", "size")
#: How many causes are told.
_FIRST = 6
#: A held-out error that is larger by at most this share is said to be about as small.
_ALIKE = 0.02


def rows(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    """Yield the first causes as cells under `HEAD`, by their fall, or by their score where they were not refitted."""
    ranked = [candidate for candidate in found.candidates if candidate.applicable and candidate.statistic > 0.0]
    for one in sorted(ranked, key=lambda one: -one.statistic)[:_FIRST]:
        yield (
            one.name,
            f"{one.statistic:.0f}" if one.parameters else "",
            f"{one.score:.0f}",
            "" if one.error is None else f"{one.error:.3f}",
            "" if one.held_out_error is None else f"{one.held_out_error:.3f}",
            ", ".join(f"{name} {value.estimate:.3g} {value.unit}" for name, value in _sizes(one).items()),
        )


def left_out(found: Diagnosis) -> str:
    """Say which refits ended no better than the nominal fit; empty where none did."""
    coarse = [candidate for candidate in found.candidates if candidate.parameters and candidate.statistic <= 0.0]
    if not coarse:
        return ""
    told = ", ".join(f"{one.name} (score {one.score:.0f})" for one in coarse)
    return f"Not in the table, for their refits are coarse and ended no better than the nominal fit: {told}."


def preferred(found: Diagnosis) -> str:
    """Say whether the held-out runs alone prefer the extended model to the other causes; empty without one."""
    if found.gain is None:
        return ""
    best, own = " and ".join(found.best), found.gain.extended["pooled"]
    others = sorted(
        (candidate.held_out_error, candidate.name)
        for candidate in found.candidates
        if candidate.held_out_error is not None and candidate.name not in found.best
    )
    smaller = [f"{name} ({error:.3f})" for error, name in others if error < own]
    close = [f"{name} ({error:.3f})" for error, name in others if own <= error <= (1.0 + _ALIKE) * own]
    said = [f"Held out, nRMSE is {own:.3f} with {best} and {found.gain.nominal['pooled']:.3f} without any cause."]
    if smaller:
        said.append(f"It is smaller with {', '.join(smaller)}.")
    if close:
        said.append(f"It is larger by at most {100 * _ALIKE:.0f} % with {', '.join(close)}.")
    if smaller or close:
        said.append(f"By this number the held-out run alone does not prefer {best}.")
    else:
        said.append(f"With every other cause that was refitted it is larger by more than {100 * _ALIKE:.0f} %.")
    return " ".join(said)


def _sizes(candidate: Candidate) -> dict[str, Estimate]:
    """Return the sizes of a cause without shapes, which say nothing of how large it is."""
    shapes = {parameter.short for parameter in find(candidate.name).parameters if parameter.shape}
    return {name: value for name, value in (candidate.parameters or {}).items() if name not in shapes}
