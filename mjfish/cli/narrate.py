"""A diagnosis told in the terminal: verdict, cause, gain, rivals, what a refit hides, what could not have been seen."""

from __future__ import annotations

from collections.abc import Mapping

from rich.markup import escape
from rich.table import Table

from mjfish.cli.console import out
from mjfish.diagnose import Diagnosis
from mjfish.effects import Effect
from mjfish.frames import CHANNELS

_COLOURS = {"named": "green", "nothing_wrong": "green", "cannot_tell": "yellow", "unexplained": "red"}


def diagnosis(result: Diagnosis, known: Mapping[str, Effect]) -> None:
    """Print a diagnosis; `known` are the causes that were candidates."""
    out.print(f"[bold {_COLOURS[result.verdict]}]{result.verdict}[/]  {escape(result.message)}", soft_wrap=True)
    if result.best:
        out.print(_cause(result))
    if result.gain is not None:
        out.print(_gain(result))
    if result.where is not None:
        where = result.where
        out.print(
            f"The misfit is densest in {where.channel} ({where.channels[where.channel]:.0%} of it), "
            f"trial {escape(where.trial)}, {where.part}, {where.phase} of the beat.",
            soft_wrap=True,
        )
    if result.candidates:
        out.print(_candidates(result))
    _experiments(result, known)
    _blind(result)
    for remark in result.remarks:
        out.print(f"Remark: {escape(remark)}", soft_wrap=True)


def _cause(result: Diagnosis) -> Table:
    title = {"named": "Cause", "cannot_tell": "Best of the rivals"}.get(result.verdict, "Closest candidate, not named")
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
    for name in names:
        out.print(f"To confirm {name}: {escape(known[name].confirm)}.", soft_wrap=True)


def _blind(result: Diagnosis) -> None:
    """Say which sizes would have shown."""
    sizes = [
        f"{name} {size:.2g}"
        for c in result.candidates
        if c.applicable and c.smallest_visible
        for name, size in c.smallest_visible.items()
    ]
    for c in result.candidates:
        if not c.applicable:
            out.print(f"Not tried: {c.name}, {escape(c.remark)}.", soft_wrap=True)
    if sizes and result.verdict in ("nothing_wrong", "named"):
        out.print(f"Smallest sizes that would have shown: {', '.join(sizes)}.", soft_wrap=True)
