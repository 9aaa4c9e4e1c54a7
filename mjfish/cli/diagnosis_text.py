"""A diagnosis in the terminal: in fifteen lines, or all of it."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mjfish.cli import console
from mjfish.reporting.words import NONE, channel_name, estimate, interval, named_as, number, p_value, percent, unit

if TYPE_CHECKING:
    from rich.table import Table

    from mjfish.diagnosis import DiagnosisData, Estimate, Splits
    from mjfish.diagnosis.table import Table as Evidence

#: Lines of a diagnosis, where not everything is asked for.
LINES = 15
#: Standard errors by which a coefficient must move to be listed.
_MOVED = 2.0
_COLOURS = {"named": "green", "nothing_wrong": "green", "cannot_tell": "yellow", "unexplained": "red"}
#: What to do about a status that is not ok.
_REMEDIES = {
    "fit_not_converged": "a fit stopped before its optimum, and the numbers may be off; look for a better optimum with "
    "'mjfish identify DATASET --starts 16', and start from it (table [start] of dataset.toml)",
    "failed": "a part of the diagnosis failed, and nothing is claimed; mend it, or leave it out, and diagnose again",
}


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
    if result.status != "ok":
        console.complain(result.status, _REMEDIES.get(result.status, "take the numbers with care"))
    first = [_Item(result.verdict, result.message, f"bold {_COLOURS[result.verdict]}")]
    gain = _gain_item(result)
    nothing = "nothing; --out DIR writes report, numbers, curves, log and the extended fish"
    wrote = console.listed(written) or nothing
    last = [_Item(_word(w), text) for w, text in (("next", _next(result, dataset)), ("wrote", wrote), *then)]
    sizes, remarks = list(_sizes(result)), list(_remarks(result))
    if verbose:
        _print([*first, *sizes, *gain, *remarks, *last])
        _rest(result)
        return
    room = LINES - 1 - sum(item.lines() for item in (*first, *gain, *last))
    kept = _fitting(sizes, max(room, 1))
    room = max(room - sum(item.lines() for item in kept), 0)
    shown = remarks if _fitting(remarks, room) == remarks else [item.shortened() for item in remarks][:room]
    counts = (("size", len(sizes) - len(kept)), ("remark", len(remarks) - len(shown)))
    left = [f"{count} more {what}{'s' if count > 1 else ''}" for what, count in counts if count]
    more = _Item(_word("more"), f"{', '.join([*left, 'candidates and tables'])}: --verbose", "dim")
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
        yield _Item(_word("mechanism"), named_as(mechanism))
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
    for name, value in own.items():
        if name not in knots:
            yield _size(word, name, value)
    if unread := len(knots.intersection(own)):
        yield _Item(_word(word), f"and {unread} values of smooth curves, which --json writes")


def _size(word: str, name: str, value: Estimate) -> _Item:
    known = f"({ends})" if (ends := interval(value)) else "(on its bound)"
    sized = f"{estimate(value)} {unit(value.unit)}".rstrip()
    return _Item(_word(word), f"{name} {sized} {known}{'' if word == 'size' else ', not named'}")


def _gain_item(result: DiagnosisData) -> list[_Item]:
    gain = result.gain
    if gain is None:
        return []
    before, after = (percent(errors["pooled"]) for errors in (gain.nominal, gain.extended))
    if not result.best:
        return [_Item(_word("held out"), f"nRMSE {before} of the nominal model, which was not extended")]
    less = f"{percent(gain.relative_reduction)} less ({percent(gain.low)} to {percent(gain.high)})"
    return [_Item(_word("held out"), f"nRMSE {before} before, {after} after: {less}")]


def _remarks(result: DiagnosisData) -> Iterator[_Item]:
    """Yield findings and remarks, the worst first."""
    for finding in result.checks.findings:
        yield _Item(_word(finding.severity), f"{finding.code}: {finding.message}")
    for remark in result.remarks:
        yield _Item(_word("remark"), remark)


def _next(result: DiagnosisData, dataset: str) -> str:
    """Return what to do next, in one sentence."""
    program = console.program()
    if result.failures:
        part, reason = next(iter(result.failures.items()))
        return f"mend what failed, {part} first ({reason}), or leave it out, and diagnose again"
    if result.checks.blocks and result.verdict == "cannot_tell":
        return result.checks.blocks[0].remedy
    if result.rivals and result.setup.plannable:
        return f"{program} plan {dataset} ranks runs by how far they set the rivals apart"
    if result.verdict == "named":
        return f"confirm it: {result.setup.causes[result.causes[0].name].confirm}"
    if result.verdict == "nothing_wrong" and result.setup.plannable:
        return f"{program} plan {dataset} has runs that would show more"
    if result.where is not None:
        return _unexplained(result)
    return f"{program} inspect {dataset} says what these runs cannot show"


def _unexplained(result: DiagnosisData) -> str:
    """Return what to do where no cause explains the misfit: mend the data, test what comes closest, look further."""
    suspect = dict.fromkeys(finding.code for finding in result.checks.findings if finding.severity == "suspect")
    steps = [f"mend {' and '.join(suspect)} first, it may be the cause"] if suspect else []
    if closest := result.closest:
        steps.append(f"{closest} comes closest: to test it, {result.setup.causes[closest].confirm}")
    steps.append(f"the misfit is densest in {_densest(result)}; for a cause of your own: --effects FILE")
    return "; ".join(steps)


def _densest(result: DiagnosisData) -> str:
    """Return the channel and the trial that hold most of the misfit."""
    where = result.where
    assert where is not None  # noqa: S101 - checked by the callers
    share = percent(where.channels[where.channel], 2)
    return f"{channel_name(where.channel)} ({share} of it), trial {where.trial}"


def _rest(result: DiagnosisData) -> None:
    """Print what fifteen lines have no room for: tables, where the misfit is, what is unseen."""
    if result.gain is not None:
        console.show(_gain(result))
    _experiments(result)
    if result.table.rows:
        console.show(_evidence(result.table))
    _biased(result)
    _where(result)
    _undetectable(result)


def show_splits(result: Splits) -> None:
    """Print how often each mechanism is named and each verdict came, and what every split says."""
    known = len(result.diagnosed)
    title = "Mechanisms, by the splits in which they are named"
    table = console.table(
        title,
        ("mechanism", "named", "with its form", "certain beside rivals", "not named, part of the best"),
        ("mechanism",),
    )
    for share in result.mechanisms:
        table.add_row(share.name, f"{share.count} of {known}", *map(str, (share.form, share.certain, share.not_named)))
    if table.row_count:
        console.show(table)
    texts = ("held out", "fitted", "verdict", "mechanisms")
    table = console.table("Splits", (*texts, "held-out error less by"), texts)
    for split in result.splits:
        gain, verdict = NONE, (split.verdict or NONE).replace("_", " ")
        if split.gain is not None:
            ends = f"{percent(split.gain.low, 2)} to {percent(split.gain.high, 2)}"
            gain = f"{percent(split.gain.relative_reduction, 2)}  ({ends})"
        held_out = f"{', '.join(split.held_out)}{' (as divided)' if split.declared else ''}"
        table.add_row(held_out, ", ".join(split.fitted), verdict, split.summary(), gain)
    table.caption = "The splits share runs: how often something comes is no probability."
    console.show(table)
    console.say(result.headline())


def _gain(result: DiagnosisData) -> Table:
    gain = result.gain
    assert gain is not None  # noqa: S101 - checked by the caller
    title = "Held-out trials: nRMSE before and after"
    table = console.table(title, ("channel", "nominal", "extended", "reduction"), ("channel",))
    for channel in gain.nominal:
        before, after = gain.nominal[channel], gain.extended[channel]
        reduction = percent(1.0 - after / before) if before > 0.0 else ""
        if channel == "pooled":
            reduction += f"  ({percent(gain.low)} to {percent(gain.high)})"
        table.add_row(channel_name(channel), percent(before), percent(after), reduction)
    table.add_row("mean speed error [m/s]", *map(number, gain.mean_speed_error), "")
    return table


def _evidence(evidence: Evidence) -> Table:
    """Return the table that the verdict is read from, a row for every set that was compared."""
    from mjfish.diagnosis.thresholds import THRESHOLDS as LIMITS

    headings = ("causes", "LR", "behind", "rival p", "best", "remains", "fit p", "held out", "error")
    table = console.table("What the verdict is read from", headings, ("causes",))
    for row in evidence.rows:
        tested = (percent(row.left), p_value(row.fit_p)) if row.tests else (NONE, NONE)
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
        f"how often it is the best when one run is left out; remains: share left, little below {percent(LIMITS.left)} "
        f"({percent(LIMITS.exact)} without a form, or with a learned one); fit p: of what is left, nothing from "
        f"{LIMITS.goodness:g} on; held out, error: log-likelihood gained there, and nRMSE. p of the nominal model"
        f"{' beside random causes' if evidence.random else ''}: {p_value(evidence.p_wrong)}, something is wrong below "
        f"{LIMITS.alarm}."
    )
    return table


def _experiments(result: DiagnosisData) -> None:
    names = [cause.name for cause in result.causes] or [name for group in result.rivals for name in group]
    if result.rivals and result.setup.plannable:
        apart = " from ".join(names)
        console.say(f"To tell {apart}: `mjfish plan` on this dataset ranks runs by how far they set them apart.")
    console.say(*(f"To confirm {name}: {result.setup.causes[name].confirm}." for name in names))


def _biased(result: DiagnosisData) -> None:
    """List the coefficients that the missing cause had biased by more than their standard error."""
    from mjfish.estimation.fit import Z95

    moved = []
    for name, before in result.nominal.items() if result.best else ():
        after = result.extended.get(name)
        if after is None:
            continue
        error = max((after.high - after.low) / (2.0 * Z95), 1e-300)
        if abs(after.estimate - before.estimate) > _MOVED * error:
            moved.append(f"{name} {number(before.estimate)} to {number(after.estimate)}")
    if moved:
        console.say(f"Coefficients that had absorbed part of it, without and with the cause: {', '.join(moved)}.")


def _where(result: DiagnosisData) -> None:
    """Say where the misfit sits, and what describes it where nothing explains it."""
    if (where := result.where) is not None:
        console.say(
            f"The misfit is densest in {_densest(result)}, {where.part}, {where.phase} of the beat, {where.speed} of "
            f"the surge, {where.turn} of the yaw rate."
        )
    if result.force:
        surge, sway, yaw = (percent(max(shares), 2) for shares in zip(*(f.share for f in result.force), strict=True))
        console.say(
            f"The missing force is {surge} in surge, {sway} in sway and {yaw} in yaw moment of what moves the fish "
            "(root mean squares, each in the trial where it is most)."
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
