"""What docs/real-fish.md says of the causes: which were refitted, which rank by their score, what held-out runs say."""

from __future__ import annotations

from collections.abc import Iterator

from mjfish.diagnosis import Diagnosis, Estimate, Row
from mjfish.effects import find

HEAD = ("cause", "fall of the sum of squares", "score", "nRMSE fitted", "nRMSE held out", "size")
#: How many causes are told.
_FIRST = 6
#: A held-out error that is larger by at most this share is said to be about as small.
_ALIKE = 0.02


def rows(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    """Yield the first causes as cells under `HEAD`, by their fall, or by their score where they were not refitted."""
    ranked = [candidate for candidate in found.candidates if candidate.applicable and candidate.evidence > 0.0]
    for one in sorted(ranked, key=lambda one: -one.evidence)[:_FIRST]:
        if (row := one.row) is None:
            yield one.name, "", f"{one.score:.0f}", "", "", ""
            continue
        yield (
            one.name,
            f"{row.gain:.0f}",
            f"{one.score:.0f}",
            "" if row.error is None else f"{row.error:.3f}",
            "" if row.held_out_error is None else f"{row.held_out_error:.3f}",
            ", ".join(f"{name} {value.estimate:.3g} {value.unit}" for name, value in _sizes(row).items()),
        )


def left_out(found: Diagnosis) -> str:
    """Say which refits ended no better than the nominal fit; empty where none did."""
    coarse = [candidate for candidate in found.candidates if candidate.row and candidate.row.gain <= 0.0]
    if not coarse:
        return ""
    told = ", ".join(f"{one.name} (score {one.score:.0f})" for one in coarse)
    return f"Not in the table, for their refits are coarse and ended no better than the nominal fit: {told}."


def preferred(found: Diagnosis) -> str:
    """Say whether the held-out runs alone prefer the extended model to the other causes; empty without one."""
    if found.gain is None:
        return ""
    best, own = " and ".join(found.best), found.gain.extended["pooled"]
    rows = (row for row in found.table.rows if len(row.names) == 1 and row.names[0] not in found.best)
    others = sorted((row.held_out_error, row.names[0]) for row in rows if row.held_out_error is not None)
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


def _sizes(row: Row) -> dict[str, Estimate]:
    """Return the sizes of a cause without shapes, which say nothing of how large it is, by short name."""
    sizes = {p.short: row.sizes.get(p.name) for p in find(row.names[0]).parameters if not p.shape}
    return {name: value for name, value in sizes.items() if value is not None}
