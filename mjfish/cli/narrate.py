"""A diagnosis told in the terminal: verdict, cause, gain, rivals, what a refit hides, what could not have been seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rich.markup import escape
from rich.table import Table

from mjfish.cli.console import out
from mjfish.diagnosis import Diagnosis
from mjfish.effects import Effect
from mjfish.estimation.fit import Z95
from mjfish.frames import CHANNELS

#: Standard errors by which a coefficient must move to be told.
_PUSHED = 2.0
_COLOURS = {"named": "green", "nothing_wrong": "green", "cannot_tell": "yellow", "unexplained": "red"}


def diagnosis(result: Diagnosis, known: Mapping[str, Effect]) -> None:
    """Print a diagnosis; `known` are the causes that were candidates."""
    out.print(f"[bold {_COLOURS[result.verdict]}]{result.verdict}[/]  {escape(result.message)}", soft_wrap=True)
    if result.best:
        out.print(_cause(result))
    if result.gain is not None:
        out.print(_gain(result))
    _experiments(result, known)
    if result.candidates:
        out.print(_candidates(result))
    _absorbed(result)
    _where(result)
    _blind(result)
    for finding in result.checks.findings:
        out.print(f"Data, {finding.severity}: {escape(finding.message)}", soft_wrap=True)
    for remark in result.remarks:
        out.print(f"Remark: {escape(remark)}", soft_wrap=True)


def _where(result: Diagnosis) -> None:
    """Say where the misfit sits, how it scales, and what describes it where nothing explains it."""
    if (where := result.where) is not None:
        out.print(
            f"The misfit is densest in {where.channel} ({where.channels[where.channel]:.0%} of it), "
            f"trial {escape(where.trial)}, {where.part}, {where.phase} of the beat, "
            f"{where.speed} of the surge, {where.turn} of the yaw rate.",
            soft_wrap=True,
        )
    if result.force:
        along, across, turning = (f"{share:.0%}" for share in np.max([one.share for one in result.force], axis=0))
        out.print(
            f"The missing force is {along} along, {across} across and {turning} in moment of what moves the fish (root "
            "mean squares, each in the trial where it is most).",
            soft_wrap=True,
        )
    if (seen := result.fingerprint) is not None and (seen.exponent is not None or seen.odd is not None):
        parts = []
        if seen.exponent is not None:
            predicted = seen.predicted.exponent
            told = "" if predicted is None else f", predicted {predicted:g}"
            parts.append(f"goes as frequency to the {seen.exponent:.2g} ({seen.low:.2g} to {seen.high:.2g}{told})")
        if seen.odd is not None:
            parts.append(f"{seen.odd:.0%} of it breaks the left-right symmetry")
        out.print(f"What the best explanation adds {'; '.join(parts)}.", soft_wrap=True)
    if (described := result.description) is not None and described.terms:
        terms = "; ".join(f"{term.what} (size {term.size:.2g} SI per metre)" for term in described.terms)
        out.print(
            f"A description, not a cause, of {described.explained:.0%} of the misfit: {escape(terms)}.", soft_wrap=True
        )


def _absorbed(result: Diagnosis) -> None:
    """Say which coefficients the missing cause had pushed, in units of their standard error."""
    moved = []
    for name, before in result.nominal.items():
        after = result.extended.get(name)
        if after is None or not result.best:
            continue
        error = max((after.high - after.low) / (2.0 * Z95), 1e-300)
        if abs(after.estimate - before.estimate) > _PUSHED * error:
            moved.append(f"{name} {before.estimate:.3g} to {after.estimate:.3g}")
    if moved:
        out.print(f"The refit had absorbed part of it; without the cause, with it: {', '.join(moved)}.", soft_wrap=True)


def _cause(result: Diagnosis) -> Table:
    if result.verdict == "named":
        title = "Cause"
    else:
        title = "Best of the rivals" if result.rivals else "Closest candidate, not named"
    table = Table(title=title)
    for heading in ("parameter", "estimate", "95 % interval", "unit"):
        table.add_column(heading)
    for name, value in result.extended.items():
        if name.partition(".")[0] in result.best:
            table.add_row(name, f"{value.estimate:.4g}", f"{value.low:.4g} to {value.high:.4g}", value.unit)
    return table


def _gain(result: Diagnosis) -> Table:
    gain = result.gain
    assert gain is not None  # noqa: S101 - checked by the caller
    table = Table(title="Held-out trials: nRMSE before and after")
    for heading in ("channel", "nominal", "extended", "reduction"):
        table.add_column(heading, justify="left" if heading == "channel" else "right")
    for channel in (*CHANNELS, "pooled"):
        before, after = gain.nominal[channel], gain.extended[channel]
        shown = f"{1.0 - after / before:.1%}"
        if channel == "pooled":
            shown += f"  ({gain.low:.1%} to {gain.high:.1%})"
        table.add_row(channel, f"{before:.4f}", f"{after:.4f}", shown)
    before, after = gain.mean_speed_error
    table.add_row("mean speed error [m/s]", f"{before:.4f}", f"{after:.4f}", "")
    return table


def _candidates(result: Diagnosis) -> Table:
    table = Table(title="Candidates, each fitted together with the coefficients")
    for heading in ("cause", "LR", "p", "held out", "rival p", "fit p", "hidden"):
        table.add_column(heading, justify="left" if heading == "cause" else "right", no_wrap=True)
    for c in result.candidates:
        if not c.applicable:
            continue
        held = "" if c.held_out_gain is None else _large(c.held_out_gain)
        chances = (_chance(p) for p in (c.rival_p, c.fit_p))
        table.add_row(c.name, _large(c.statistic), _chance(c.p_value), held, *chances, f"{c.absorbed:.0%}")
    table.caption = (
        "LR: fall of the sum of squares; held out: log-likelihood gained there; rival p: of the margin to the best; "
        "fit p: of what is left; hidden: by a refit of the coefficients"
    )
    return table


def _large(number: float) -> str:
    return f"{number:,.0f}" if abs(number) >= 1e3 else f"{number:.3g}"


def _chance(p: float | None) -> str:
    return "" if p is None else "< 1e-99" if p < 1e-99 else f"{p:.2g}"


def _experiments(result: Diagnosis, known: Mapping[str, Effect]) -> None:
    names = [cause.name for cause in result.causes] or [name for group in result.rivals for name in group]
    if result.rivals:
        out.print(
            f"To tell {' from '.join(names)}: `mjfish plan` on this dataset ranks runs by how far they set them apart.",
            soft_wrap=True,
        )
    for name in names:
        out.print(f"To confirm {name}: {escape(known[name].confirm)}.", soft_wrap=True)


def _blind(result: Diagnosis) -> None:
    """Say which causes could not have been seen, and which sizes of the others would have shown."""
    for name, reason in result.blind.items():
        out.print(f"Could not be seen: {name}, {escape(reason)}.", soft_wrap=True)
    sizes = [
        f"{name} {size:.2g}"
        for c in result.candidates
        if c.applicable and c.smallest_visible and c.name not in result.blind
        for name, size in c.smallest_visible.items()
    ]
    if sizes:
        out.print(f"Smallest sizes that would have shown: {', '.join(sizes)}.", soft_wrap=True)
