"""The page of a diagnosis: what its templates show, and what is said of every candidate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mjfish.diagnosis import Candidate, Diagnosis, Estimate, Splits
from mjfish.diagnosis.curves import knots_of
from mjfish.diagnosis.select import GOODNESS, KEEP
from mjfish.diagnosis.where import FIFTHS
from mjfish.files import write_text
from mjfish.frames import CHANNELS
from mjfish.reporting.html.curves import form_rows
from mjfish.reporting.html.figures import beat_figure, force_figure, overlay_figure
from mjfish.reporting.html.pages import render
from mjfish.reporting.words import CHANNEL_NAMES, VERDICTS, number, percent, unit

#: With a larger confounded share a signature says little.
_CONFOUNDED = 0.9


def detectable(candidate: Candidate, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the minimum detectable effect of each amplitude, with its unit."""
    effect = diagnosis.effects.get(candidate.name)
    units = {p.name: p.unit for p in effect.parameters} if effect else {}
    return tuple(
        f"{name.rpartition('.')[2]} {number(size, 2)} {unit(units.get(name, '-'))}".strip()
        for name, size in (candidate.minimum_detectable or {}).items()
    )


def remark(candidate: Candidate, diagnosis: Diagnosis) -> str:
    """Return all that is said of a candidate: the judgement, then what to mind about its numbers."""
    sentence = judgement(candidate, diagnosis, detectable(candidate, diagnosis))
    return " ".join(filter(None, [sentence, *cautions(candidate, diagnosis)]))


def judgement(candidate: Candidate, diagnosis: Diagnosis, sizes: Sequence[str]) -> str:
    """Say in a sentence why the candidate is, or is not, the cause.

    Args:
        candidate: to judge.
        diagnosis: that it is of.
        sizes: its minimum detectable effects.
    """
    if not candidate.applicable:
        return f"Not tried: {candidate.remark}."
    if candidate.name in diagnosis.certain:
        return _at_work(candidate, diagnosis)
    if any(candidate.name in group for group in diagnosis.rivals):
        left = f", and with it {_left(candidate)}" if (candidate.name,) in diagnosis.alternatives else ""
        return f"Possible: the data cannot tell it from its rivals{left}."
    if candidate.parameters is None:
        return _not_refitted(candidate, diagnosis, sizes)
    if diagnosis.verdict == "cannot_tell" and (candidate.name,) in diagnosis.alternatives:
        if _clean(candidate):
            return "Possible: it explains no more than chance might, and with it nothing systematic is left."
        return f"Possible, and the closest: with it {_left(candidate)}."
    if candidate.rival_p is not None and candidate.fit_p is None:
        return _ruled_out(diagnosis)
    if not _clean(candidate):
        return f"Close, but with it in the model {_left(candidate)}."
    if candidate.held_out_gain is not None and candidate.held_out_gain <= 0.0:
        return "Fits, but makes the held-out trials no better."
    return ""


def cautions(candidate: Candidate, diagnosis: Diagnosis) -> list[str]:
    """Return what to mind about the numbers of a candidate."""
    found = []
    if candidate.applicable and candidate.confounded > _CONFOUNDED and candidate.name not in diagnosis.undetectable:
        share = percent(candidate.confounded, 2)
        found.append(f"A refit of the coefficients removes {share} of its signature: these trials say little about it.")
    stuck = [name for name, value in (candidate.parameters or {}).items() if value.at_bound]
    if stuck:
        found.append(f"On its bound: {', '.join(stuck)}.")
    if candidate.applicable and candidate.remark:
        found.append(candidate.remark)
    return found


def _at_work(candidate: Candidate, diagnosis: Diagnosis) -> str:
    if diagnosis.verdict != "named":
        return "At work, whichever of the others is."
    others = [cause.name for cause in diagnosis.causes if cause.name != candidate.name]
    if others:
        return f"One of the causes, beside {' and '.join(others)}."
    return f"The cause: with it in the model {_left(candidate)}."


def _not_refitted(candidate: Candidate, diagnosis: Diagnosis, sizes: Sequence[str]) -> str:
    if candidate.name in diagnosis.undetectable:
        return f"Undetectable: {diagnosis.undetectable[candidate.name]}."
    if candidate.p_value < KEEP and any(other.parameters is not None for other in diagnosis.candidates):
        return "Not refitted: others have better scores."
    if not sizes:
        return "No sign of it."
    return f"No sign of it; the minimum detectable effect is {' and '.join(sizes)}."


def _ruled_out(diagnosis: Diagnosis) -> str:
    """Say by whom: single causes stand against the best single one, whether or not it needs company."""
    leader = max(diagnosis.candidates, key=lambda other: other.rival_p or 0.0).name
    alone = " as the only cause" if any(len(names) > 1 for names in diagnosis.alternatives) else ""
    return f"Ruled out{alone}: {leader} explains the misfit better by more than chance allows."


def _clean(candidate: Candidate) -> bool:
    return candidate.fit_p is None or candidate.fit_p >= GOODNESS


def _left(candidate: Candidate) -> str:
    return f"{'nothing' if _clean(candidate) else 'something'} systematic is left"


_PARTS = ("start-up", "transition", "steady")


def write_diagnosis(diagnosis: Diagnosis, path: Path, splits: Splits | None = None) -> None:
    """Write the page of a diagnosis, with its splits where there are some, as one HTML file, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render_diagnosis(diagnosis, splits))


def render_diagnosis(diagnosis: Diagnosis, splits: Splits | None = None) -> str:
    """Return the page of a diagnosis as HTML: self-contained, everything that came from a user escaped."""
    overlays = sorted(diagnosis.overlays, key=lambda overlay: not overlay.held_out)
    models = (diagnosis.nominal_model, diagnosis.extended_model)
    declared = {p.name: p for p in (*diagnosis.problem.parameters, *(p for m in models for p in m.parameters))}
    possible = [cause.name for cause in diagnosis.causes] or [name for group in diagnosis.rivals for name in group]
    names = [*diagnosis.nominal, *(name for name in diagnosis.extended if name not in diagnosis.nominal)]
    knots = knots_of(diagnosis.effects.values())
    return render(
        "diagnosis.html.j2",
        diagnosis=diagnosis,
        splits=splits,
        badge=VERDICTS[diagnosis.verdict],
        sampled=sum(len(overlay.trial.time) for overlay in diagnosis.overlays),
        errors=errors(diagnosis),
        channel_names=CHANNEL_NAMES,
        trials=[(overlay, overlay_figure(diagnosis, overlay)) for overlay in overlays],
        beat=beat_figure(diagnosis),
        where=shares(diagnosis),
        force=force_figure(diagnosis),
        effects=diagnosis.effects,
        chosen={*diagnosis.certain, *(name for group in diagnosis.rivals for name in group)},
        remark=lambda candidate: remark(candidate, diagnosis),
        detectable=lambda candidate: detectable(candidate, diagnosis),
        keep=KEEP,
        goodness=GOODNESS,
        experiments=[diagnosis.effects[name] for name in possible if name in diagnosis.effects],
        declared=declared,
        names=[name for name in names if name not in knots],
        knots=knots,
        unread=len(knots.intersection(names)),
        forms=form_rows(diagnosis.mechanisms),
        whiskers=whiskers,
    )


def errors(diagnosis: Diagnosis) -> list[tuple[str, float, float]]:
    """Return rows of held-out nRMSE: channel (or all of them), of the nominal and of the extended model."""
    gain = diagnosis.gain
    if gain is None:
        return []
    return [(CHANNEL_NAMES[name], gain.nominal[name], gain.extended[name]) for name in (*CHANNELS, "pooled")]


def shares(diagnosis: Diagnosis) -> list[tuple[str, str, dict[str, float]]]:
    """Return where the misfit sits: title of each group, where it is densest, and all shares of it in order."""
    where = diagnosis.where
    if where is None:
        return []
    trials = [trial.name for trial in diagnosis.dataset.trials]
    named = {CHANNEL_NAMES[name]: share for name, share in where.channels.items()}
    return [
        ("channel", CHANNEL_NAMES[where.channel], _in_order(named, CHANNEL_NAMES.values())),
        ("trial", where.trial, _in_order(where.trials, trials)),
        ("part of the run", where.part, _in_order(where.parts, _PARTS)),
        ("phase of the beat", where.phase, _in_order(where.phases, sorted(where.phases))),
        ("surge", where.speed, _in_order(where.speeds, FIFTHS)),
        ("|yaw rate|", where.turn, _in_order(where.turns, FIFTHS)),
    ]


def _in_order(found: dict[str, float], order: Iterable[str]) -> dict[str, float]:
    """Return the shares in this order, those of other names behind."""
    return {name: found[name] for name in (*(n for n in order if n in found), *found)}


def whiskers(*estimates: Estimate) -> list[dict[str, float]]:
    """Place estimates and their intervals on one line, in percent of its width, with a margin at both ends."""
    low, high = min(e.low for e in estimates), max(e.high for e in estimates)
    width = max(high - low, 1e-300)

    def place(value: float) -> float:
        return round(6.0 + 88.0 * min(max((value - low) / width, 0.0), 1.0), 2)

    return [{"at": place(e.estimate), "low": place(e.low), "high": place(e.high)} for e in estimates]
