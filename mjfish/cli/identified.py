"""How `mjfish identify` tells its result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.markup import escape
from rich.table import Table

from mjfish.cli import console
from mjfish.estimation import table_iv
from mjfish.estimation.agreement import HORIZONS
from mjfish.estimation.assessment import Assessment
from mjfish.estimation.report import Identification
from mjfish.estimation.score import PREFIX
from mjfish.estimation.uncertainty.profile import Profile
from mjfish.frames import CHANNELS


def show(result: Identification, profiles: Sequence[Profile]) -> None:
    """Print the coefficients with intervals and remarks, the agreement per trial, and what the data say in words."""
    told = result.assessment
    console.out.print(_coefficients(result))
    if told is not None:
        console.out.print(_agreement(told))
        console.out.print(_fits(told))
    for line in _words(result, profiles):
        console.out.print(escape(line), soft_wrap=True)


def _coefficients(result: Identification) -> Table:
    table = Table(title=f"{escape(result.dataset.name)}: estimates with 95 % intervals")
    for heading in ("parameter", "estimate", "low", "high", "standard error", "remark"):
        table.add_column(heading, justify="left" if heading in ("parameter", "remark") else "right")
    fit, told = result.fit, result.assessment
    for index, (p, at_bound) in enumerate(zip(fit.parameters, fit.at_bound, strict=True)):
        low, high = fit.interval(p.name) if told is None else told.intervals.interval(p.name)
        sigma = fit.sigma[p.name] if told is None else float(told.intervals.sigma[index])
        cells = (f"{value:.4g}" for value in (fit.values[p.name], low, high, sigma))
        table.add_row(p.name, *cells, "rests on its bound" if at_bound else "")
    return table


def _agreement(told: Assessment) -> Table:
    table = Table(title="simulated: RMSE / nRMSE, in m/s and rad/s, over the range")
    for heading in ("trial", "role", *CHANNELS):
        table.add_column(heading, justify="left" if heading in ("trial", "role") else "right")
    for row in told.table:
        cells = (table_iv.text(a, b) for a, b in zip(row.rmse, row.nrmse, strict=True))
        table.add_row(escape(row.name), row.role, *cells)
    return table


def _fits(told: Assessment) -> Table:
    """Fit percentages of whole trials: simulated, and predicted some samples ahead."""
    table = Table(title="fit in percent: simulated, and predicted so many samples ahead")
    horizons = (None, *HORIZONS)
    table.add_column("trial")
    table.add_column("channel")
    for horizon in horizons:
        table.add_column("simulated" if horizon is None else str(horizon), justify="right")
    whole = {(a.trial, a.channel, a.horizon): a.fit for a in told.agreements if a.part == "whole"}
    for trial in dict.fromkeys(a.trial for a in told.agreements):
        for channel in CHANNELS:
            cells = (f"{whole[trial, channel, h]:.1f}" if (trial, channel, h) in whole else "-" for h in horizons)
            table.add_row(escape(trial), channel, *cells)
    return table


def _words(result: Identification, profiles: Sequence[Profile]) -> Iterator[str]:
    told = result.assessment
    if told is not None:
        yield from (f"- {weakness.text}" for weakness in told.weaknesses)
        yield f"- {told.stability.text}"
        tests, rank = told.tests, told.criteria
        yield (
            f"- residuals: {tests.status}; chance of being white {tests.p_white:.2g}, "
            f"of being independent of the drive {tests.p_independent:.2g}"
        )
        yield f"- AICc {rank.aicc:.6g}, BIC {rank.bic:.6g}, FPE {rank.fpe:.4g} with {rank.parameters} parameters"
        if any(r.role == "held_out" and not r.trial.starts_at_rest for r in told.residuals):
            yield f"- what belongs to a held-out trial alone was fitted on its first {PREFIX:.0%}, which is not scored"
    for one in profiles:
        yield (
            f"- profile of {one.name}: {one.estimate:.4g}, 95 % from {one.low:.4g} ({one.low_side}) to {one.high:.4g} "
            f"({one.high_side}); {one.status}"
        )
    yield from (f"- {remark}" for remark in result.remarks)
    if result.starts > 1:
        yield f"{round(result.reached * result.starts)} of {result.starts} starts reached the best optimum"
    yield f"fit {result.fit.status} after {result.fit.evaluations} evaluations"
