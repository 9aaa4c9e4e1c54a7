"""A diagnosis in the terminal: in fifteen lines, or all of it."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mjfish.cli import console
from mjfish.numerics.formats import NONE, channel_name, counted, number, p_value, percent, unit

if TYPE_CHECKING:
    from rich.table import Table

    from mjfish.diagnosis import DiagnosisData, Estimate, Splits
    from mjfish.diagnosis.table import Table as Evidence

#: Lines of a diagnosis, where not everything is asked for.
LINES = 15
#: Standard errors by which a coefficient must move to be listed.
_MOVED = 2.0
_COLOURS = {"named": "green", "nothing_wrong": "green", "cannot_tell": "yellow", "unexplained": "red"}


class _Item(NamedTuple):
    """A text with the word that stands beside it, on lines no longer than the terminal's."""

    word: str
    text: str
    style: str = ""

    def lines(self) -> int:
        """Return how many lines it takes."""
        return len(console.wrapped(self.word, self.text))

    def shortened(self) -> _Item:
        """Return as much of it as one line takes."""
        return self._replace(text=textwrap.shorten(self.text, console.width_beside(self.word), placeholder=" ..."))


def show(
    result: DiagnosisData,
    dataset: str,
    written: Sequence[Path] = (),
    then: Sequence[tuple[str, str]] = (),
    *,
    verbose: bool = False,
) -> None:
    """Print a diagnosis: verdict, mechanisms with sizes or curves, gain, remarks, what to do next, what was written.

    Args:
        result: of `mjfish.diagnose` or `mjfish.load_diagnosis`.
        dataset: how the user calls its folder.
        written: files and folders.
        then: words and texts to stand below what was written.
        verbose: all of it and the tables; else `LINES` lines at most.
    """
    from mjfish.reporting.titles import notices

    if result.status != "ok":
        console.complain(result.status, result.caution.replace("DATASET", dataset))
    first = [_Item(result.verdict, result.message, f"bold {_COLOURS[result.verdict]}")]
    gain = [_Item(_word("held out"), result.held_out)] if result.held_out else []
    steps = [step.replace("mjfish ", f"{console.program()} ").replace("DATASET", dataset) for step in result.next]
    wrote = console.listed(written) or "nothing; --out DIR writes report, numbers, curves, log and the extended fish"
    told = (*(("next", step) for step in (steps if verbose else steps[:1])), ("wrote", wrote), *then)
    last = [_Item(_word(word), text) for word, text in told]
    sizes = list(_sizes(result))
    remarks = [_Item(_word(kind), text) for kind, _, text in notices(result) if kind != "status"]
    if verbose:
        _print([*first, *sizes, *gain, *remarks, *last])
        _rest(result)
        return
    room = LINES - 1 - sum(item.lines() for item in (*first, *gain, *last))
    kept = _fitting(sizes, max(room, 1))
    room = max(room - sum(item.lines() for item in kept), 0)
    shown = remarks if _fitting(remarks, room) == remarks else [item.shortened() for item in remarks][:room]
    counts = {"more size": len(sizes) - len(kept), "more remark": len(remarks) - len(shown)}
    left = [counted(count, what) for what, count in counts.items() if count]
    more = _Item(_word("more"), f"{', '.join([*left, 'steps, candidates, tables'])}: --verbose", "dim")
    _print([*first, *kept, *gain, *shown, *last, more])


def _word(word: str) -> str:
    return f"{word:9}"


def _print(items: Sequence[_Item]) -> None:
    for item in items:
        console.item(*item)


def _fitting(items: Sequence[_Item], room: int) -> list[_Item]:
    """Return the first items that take so many lines together."""
    taken = accumulate(item.lines() for item in items)
    return [item for item, lines in zip(items, taken, strict=True) if lines <= room]


def _sizes(result: DiagnosisData) -> Iterator[_Item]:
    """Yield the mechanisms with their curves, and the sizes of causes but for values of smooth curves."""
    for mechanism in result.mechanisms:
        yield _Item(_word("mechanism"), mechanism.told)
        yield from (_Item(_word("  curve"), curve.summary()) for curve in mechanism.curves)
    if result.verdict == "nothing_wrong":
        apart = result.isolability
        rows = enumerate(zip(apart.amplitudes, apart.sizes, apart.units, strict=True))
        seen = [f"{name} {number(row[k])} {unit(own)}".rstrip() for k, (name, row, own) in rows if row[k] < math.inf]
        room = 3 * console.width_beside(_word("seen from"))
        yield _Item(_word("seen from"), textwrap.shorten(", ".join(seen), room, placeholder=" ..."))
    knots = result.setup.knots
    own = {name: value for name, value in result.extended.items() if name.partition(".")[0] in result.best}
    word = "size" if result.verdict == "named" else "rival" if result.rivals else "closest"
    yield from (_size("size", *sized) for row in result.table.random for sized in row.sizes.items())
    yield from (_size(word, name, value) for name, value in own.items() if name not in knots)
    yield from (_Item(_word("delay"), f"of the joints {told}") for told in result.delays)
    if unread := len(knots.intersection(own)):
        yield _Item(_word(word), f"and {counted(unread, 'value')} of smooth curves, which --json writes")


def _size(word: str, name: str, value: Estimate) -> _Item:
    return _Item(_word(word), f"{name} {value.told}{'' if word == 'size' else ', not named'}")


def _rest(result: DiagnosisData) -> None:
    """Print what fifteen lines have no room for: tables, where the misfit is, what is unseen."""
    if result.gain is not None:
        table = console.table(
            "Held-out trials: nRMSE before and after",
            ("channel", "nominal", "extended", "change"),
            left=("channel", "change"),
        )
        for name, _, told, change in result.gain.rows:
            table.add_row(channel_name(name), *told, change)
        console.show(table)
    if result.table.rows:
        console.show(_evidence(result.table))
    _biased(result)
    _where(result)
    _undetectable(result)


def show_splits(result: Splits) -> None:
    """Print how often each mechanism is named and each verdict came, and what every split says."""
    table = console.table(
        "Mechanisms, by the splits in which they are named",
        ("mechanism", "named", "with its form", "certain beside rivals", "not named, part of the best"),
        ("mechanism",),
    )
    for share in result.mechanisms:
        named = f"{share.count} of {len(result.diagnosed)}"
        table.add_row(share.name, named, *map(str, (share.form, share.certain, share.not_named)))
    if table.row_count:
        console.show(table)
    texts = ("held out", "fitted", "verdict", "mechanisms")
    table = console.table("Splits", (*texts, "held-out error"), texts)
    for split in result.splits:
        gain, verdict = NONE if split.gain is None else split.gain.change, (split.verdict or NONE).replace("_", " ")
        held_out = f"{', '.join(split.held_out)}{' (as divided)' if split.declared else ''}"
        table.add_row(held_out, ", ".join(split.fitted), verdict, split.summary(), gain)
    table.caption = "The splits share runs: how often something comes is no probability."
    console.show(table)
    console.say(result.headline())


def _evidence(evidence: Evidence) -> Table:
    """Return the table that the verdict is read from, a row for every set that was compared."""
    from mjfish.diagnosis.thresholds import THRESHOLDS as LIMITS

    headings = ("causes", "LR", "behind", "rival\np", "best", "remains", "fit\np", "held\nout", "error")
    table = console.table("What the verdict is read from", headings, ("causes",))
    table.padding = 0  # so that the longest name of a cause stays whole at 80 columns
    for row in evidence.rows:
        tested = (percent(row.remaining), p_value(row.fit_p)) if row.tests else (NONE, NONE)
        table.add_row(
            " + ".join(row.names),
            number(row.gain),
            number(row.behind),
            p_value(row.rival_p),
            percent(row.chosen),
            *tested,
            number(row.held_out.gained if row.held_out else None),
            percent(row.held_out_error),
        )
    table.caption = (
        "LR: fall of the sum of squares; behind: by how much the best of its size explains more of all trials; "
        f"rival p: of that margin, a set stays from {LIMITS.keep} on or less than {LIMITS.close:.2g} behind; best: "
        f"how often it is the best when one run is left out; remains: share left, little below "
        f"{percent(LIMITS.remaining)} ({percent(LIMITS.exact)} without a form, or with a learned one); fit p: of what "
        f"is left, nothing from {LIMITS.goodness:g} on; held out, error: log-likelihood gained there, and nRMSE. "
        f"p of the nominal model{' beside random causes' if evidence.random else ''}: "
        f"{p_value(evidence.p_wrong)}, something is wrong below "
        f"{LIMITS.alarm}."
    )
    return table


def _biased(result: DiagnosisData) -> None:
    """List the coefficients that the missing cause had biased by more than their standard error."""
    from mjfish.estimation.fit import Z95

    both = [(name, value, result.extended[name]) for name, value in result.nominal.items() if name in result.extended]
    moved = [
        f"{name} {number(before.estimate)} to {number(after.estimate)}"
        for name, before, after in both
        if abs(after.estimate - before.estimate) > _MOVED * max((after.high - after.low) / (2.0 * Z95), 1e-300)
    ]
    if moved and result.best:
        console.say(f"Coefficients that had absorbed part of it, without and with the cause: {', '.join(moved)}.")


def _where(result: DiagnosisData) -> None:
    """Say where the misfit sits, and what describes it where nothing explains it."""
    if (where := result.where) is not None:
        console.say(
            f"The misfit is densest in {where.densest}, {where.part}, {where.phase} of the beat, {where.speed} of "
            f"the surge, {where.turn} of the yaw rate."
        )
    if result.force:
        surge, sway, yaw = (number(max(shares)) for shares in zip(*(f.share for f in result.force), strict=True))
        console.say(
            f"The missing force, as a multiple of what moves the simulated fish and its water: {surge} in surge, "
            f"{sway} in sway, {yaw} in yaw moment (root mean squares, each in the trial where it is most)."
        )
    if (described := result.description) is not None and described.terms:
        terms = "; ".join(f"{term.what} (size {number(term.size, 2)} SI per metre)" for term in described.terms)
        console.say(f"A description, not a cause, of {percent(described.explained, 2)} of the misfit: {terms}.")


def _undetectable(result: DiagnosisData) -> None:
    """List the causes that these data cannot show, and the minimum detectable effects of the others."""
    hidden = result.undetectable
    alike = {reason: ", ".join(name for name in hidden if hidden[name] == reason) for reason in hidden.values()}
    console.say(*(f"Undetectable: {names}: {reason}." for reason, names in alike.items()))
    sizes = [
        f"{name} {number(size, 2)}"
        for candidate in result.candidates
        if candidate.applicable and not candidate.failure and candidate.name not in result.undetectable
        for name, size in (candidate.minimum_detectable or {}).items()
    ]
    if sizes:
        console.say(f"Minimum detectable effects: {', '.join(sizes)}.")
